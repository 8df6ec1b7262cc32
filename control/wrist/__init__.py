"""What the wrist feels: wrench, contacts, payload, slip."""
