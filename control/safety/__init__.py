"""Safety monitor with latch and watchdog, wrist plausibility, and the lease of the arm."""
