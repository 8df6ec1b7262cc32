"""Reader of cases files."""
