"""The physical backend, in pybullet."""
