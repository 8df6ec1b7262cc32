"""The robot in pybullet."""
