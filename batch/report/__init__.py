"""A batch as one page that stands alone."""
