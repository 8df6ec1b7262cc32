"""Statistics of a batch, and comparison of two recipes."""
