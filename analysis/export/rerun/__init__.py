"""A run as a Rerun recording."""
