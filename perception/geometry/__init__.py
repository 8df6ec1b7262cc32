"""Geometry of cameras, silhouettes and items at rest."""
