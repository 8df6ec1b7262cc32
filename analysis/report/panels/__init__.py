"""Data of the panels of a report."""
