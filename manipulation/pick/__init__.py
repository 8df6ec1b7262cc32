"""Picks and places: ranked candidates, approach, lift, transfer, release, visual servoing of the grasp."""
