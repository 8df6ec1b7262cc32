"""Replay of a run: a cursor over its ticks, without a terminal."""
