"""The kinematic backend: no physics, ideal sensors."""
