"""Commands that analyse logs."""
