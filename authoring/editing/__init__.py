"""Edits of a mission's text by its tree: comments, layout and all other lines stay as they are."""
