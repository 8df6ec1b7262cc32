"""Grasp candidates, and closing on an object by feel."""
