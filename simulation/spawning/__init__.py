"""Where items stand when they come, and which ever came."""
