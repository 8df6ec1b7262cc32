"""Motions that are watched, and planned again."""
