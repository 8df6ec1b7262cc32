"""Guarded moves and the search for holes by touch."""
