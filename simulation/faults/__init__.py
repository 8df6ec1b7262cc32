"""Faults, carried out."""
