"""A comparison of two runs, rendered as text and as JSON."""
