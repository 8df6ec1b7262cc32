"""Where the cards of a chart stand."""
