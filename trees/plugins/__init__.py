"""Nodes that others bring."""
