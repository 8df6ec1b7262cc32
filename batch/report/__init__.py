"""Report of a batch as one self-contained page."""
