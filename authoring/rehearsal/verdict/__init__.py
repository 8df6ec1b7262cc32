"""Results of rehearsals, and their output."""
