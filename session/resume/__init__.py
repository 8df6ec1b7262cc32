"""Resumption of a run that was killed, interrupted, paused or ended at its limit."""
