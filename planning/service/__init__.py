"""Plan service: the interface of the planner for skills."""
