"""Pushing an object over a table, and making room by pushing."""
