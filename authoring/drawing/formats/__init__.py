"""Formats of drawings: SVG, HTML, DOT and text."""
