"""MCAP files: writing, reading and salvage of damaged ones."""
