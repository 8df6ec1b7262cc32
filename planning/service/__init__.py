"""The planner as skills meet it."""
