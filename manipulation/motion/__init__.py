"""Monitored motions and replanning."""
