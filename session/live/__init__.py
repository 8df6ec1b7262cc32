"""Viewers of a run that goes on: the socket in its folder, and the live view."""
