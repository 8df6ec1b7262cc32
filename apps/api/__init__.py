"""Python library: missions, cells, runs and batches as one uses them from a script or a notebook."""
