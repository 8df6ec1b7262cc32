"""From colour and depth to beliefs: what stands where, what hides, what nothing known explains."""
