"""Two runs beside each other: their alignment, and where they part."""
