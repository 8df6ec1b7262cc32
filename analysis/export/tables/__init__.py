"""Tables of a run: their columns and rows, and the files that hold them."""
