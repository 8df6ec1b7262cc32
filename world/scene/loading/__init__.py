"""Reading scene files."""
