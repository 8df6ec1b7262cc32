"""Plug-ins: nodes from outside picktree."""
