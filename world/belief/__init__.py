"""Belief of the robot, and memory of failed attempts."""
