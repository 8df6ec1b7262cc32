"""The truth of the simulation, and the judge who alone compares with it."""
