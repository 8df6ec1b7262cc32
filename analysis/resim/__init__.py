"""Running again from what a log holds."""
