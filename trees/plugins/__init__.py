"""Plug-ins: nodes from outside picktree."""

GROUP = "picktree.nodes"
"""Group of the entry points under which distributions offer nodes."""
