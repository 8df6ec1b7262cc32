"""Layout of a chart: text sizes, cards, frames and positions."""
