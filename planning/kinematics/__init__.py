"""Inverse kinematics and Cartesian lines."""
