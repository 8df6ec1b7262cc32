"""Comparison of two runs as text and as JSON."""
