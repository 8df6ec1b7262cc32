"""The reference of nodes: what each does, takes and may fail with, from their declarations."""
