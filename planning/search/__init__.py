"""Path search: RRT-Connect, constrained RRT, goal configurations, escape from penetration."""
