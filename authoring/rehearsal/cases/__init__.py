"""Cases files, read."""
