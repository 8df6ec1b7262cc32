"""What came of a case, and how it is told."""
