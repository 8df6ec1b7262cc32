"""MCAP files: written, read, salvaged."""
