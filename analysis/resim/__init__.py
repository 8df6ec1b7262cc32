"""Re-simulation of recorded runs, unchanged or with changes."""
