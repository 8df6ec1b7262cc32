"""Episodes: which causes were seen in a run, what was tried against each, and what came of it."""
