"""A mission checked as a whole."""
