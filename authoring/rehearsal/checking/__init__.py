"""Cases held against their mission."""
