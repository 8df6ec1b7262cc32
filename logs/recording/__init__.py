"""Writing a log, and putting the files of one together."""
