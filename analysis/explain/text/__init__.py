"""An explanation, rendered as text and as JSON."""
