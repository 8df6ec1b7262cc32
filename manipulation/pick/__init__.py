"""Picks and places: ranked candidates, approach, lift, transfer, release, and visual servoing of the grasp."""
