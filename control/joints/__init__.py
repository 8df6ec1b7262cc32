"""Joint controllers, stiff and soft."""
