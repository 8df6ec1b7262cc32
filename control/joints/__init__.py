"""Joint controllers, stiff and compliant, and external joint torques."""
