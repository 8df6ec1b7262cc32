"""Reference of nodes: purpose, ports and causes, from their declarations."""
