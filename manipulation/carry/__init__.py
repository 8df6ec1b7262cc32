"""Held objects: grip check, payload, slip."""
