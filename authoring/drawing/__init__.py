"""Drawings of missions: SVG, HTML, DOT and text, with the layout by Graphviz."""
