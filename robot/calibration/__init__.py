"""Calibration of cameras and tool at a target: viewpoints, touches, observations and their estimate."""
