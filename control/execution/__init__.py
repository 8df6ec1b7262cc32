"""The control loop, and motions as generators on it."""
