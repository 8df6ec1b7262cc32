"""Whole picks: each grasp with each place that it leads to, best first."""
