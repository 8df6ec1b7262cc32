"""The safety monitor, its latch, and the lease of the arm."""
