"""What a batch amounts to, and how two recipes compare."""
