"""Rehearsal of missions without physics: leaves answer as a case defines, and its expectations are
checked."""
