"""Ground truth of the simulation, and the scorer that compares it with the destinations."""
