"""A tree that runs: built, ticked, debugged, edited."""
