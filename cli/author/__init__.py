"""Commands for authors of missions, scenes and nodes."""
