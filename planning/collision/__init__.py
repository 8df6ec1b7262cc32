"""Collision checks of configurations, edges and trajectories."""
