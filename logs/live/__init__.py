"""A running mission as a feed for viewers."""
