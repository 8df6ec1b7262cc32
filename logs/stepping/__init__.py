"""A run tick by tick, for a terminal."""
