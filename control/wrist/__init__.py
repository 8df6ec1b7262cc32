"""Wrist wrench, contact detection, payload estimation and slip detection."""
