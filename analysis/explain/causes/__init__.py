"""Root causes: one family of explanations a file."""
