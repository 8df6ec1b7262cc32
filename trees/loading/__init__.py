"""Loading of mission files: text to checked Mission values."""
