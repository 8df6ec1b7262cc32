"""Pictures of a mission: SVG, HTML, DOT and text. Graphviz lays the nodes out."""
