"""Charts as SVG, HTML, DOT and text."""
