"""Spawning of items, and the inventory of all that ever came."""
