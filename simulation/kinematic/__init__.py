"""Kinematic backend: no physics, ideal sensors."""
