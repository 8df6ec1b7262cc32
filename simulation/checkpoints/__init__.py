"""Saved states of the two backends."""
