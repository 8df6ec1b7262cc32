"""One robot cell as skills meet it: the World, vision, handling, the operator, handovers between skills."""
