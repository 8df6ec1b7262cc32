"""Manipulation of objects: grasp, carry, place, insert, push, and retreat."""
