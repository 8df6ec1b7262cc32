"""Workers on the machines of a Ray cluster. Only separate processes load Ray."""
