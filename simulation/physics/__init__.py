"""Physics backend in pybullet."""
