"""The geometry of pictures, and of items at rest in them."""
