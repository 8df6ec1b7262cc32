"""Workers on the machines of a Ray cluster. Ray is loaded by processes of its own alone."""
