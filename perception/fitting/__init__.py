"""Which known item explains what is seen."""
