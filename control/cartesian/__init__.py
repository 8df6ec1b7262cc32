"""Cartesian controllers: impedance and velocity."""
