"""Plan trial: a plan in a scene without a mission, its syntax, result and picture."""
