"""Commands that look into logs."""
