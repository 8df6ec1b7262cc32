"""Commands for whoever writes missions, scenes and nodes."""
