"""Feed of a run: items that arrive on tables and belts, and the exchange of bins."""
