"""Robot cell as skills use it: the World, cameras, motion parameters, the operator, handovers between
skills."""
