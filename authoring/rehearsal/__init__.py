"""Missions without physics: leaves answer as a case says, and the case says what must come of it."""
