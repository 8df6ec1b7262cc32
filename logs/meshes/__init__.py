"""The meshes that a log holds."""
