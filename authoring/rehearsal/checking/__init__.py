"""Check of cases against their mission."""
