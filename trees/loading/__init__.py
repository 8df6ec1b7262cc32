"""From a mission file to a Mission."""
