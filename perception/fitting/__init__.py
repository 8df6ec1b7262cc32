"""Fits of catalogue items and holes to what a picture shows."""
