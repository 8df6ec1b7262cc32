"""Places for objects: release poses over bins, put-down on fixtures, and the belief after a release."""
