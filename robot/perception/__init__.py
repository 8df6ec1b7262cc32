"""Perception: beliefs about items, hidden objects and unknown obstacles from colour and depth images."""
