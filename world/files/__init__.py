"""picktree."""
