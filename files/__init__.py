"""Reading files: YAML with places, quantities, expressions, and faults that say what would be right."""
