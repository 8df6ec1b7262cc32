"""A plan in a scene without a mission: what is asked for, what comes of it, and its picture."""
