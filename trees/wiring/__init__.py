"""Wiring of a mission: the values that reach each input, over keys and the ports of sub-trees."""
