"""Grasp candidates, grip force, and compliant closing of the fingers."""
