"""Command line of picktree."""
