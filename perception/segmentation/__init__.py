"""Patches of one colour."""
