"""Search for paths: RRT-Connect, constraints, goals, ways out of penetration."""
