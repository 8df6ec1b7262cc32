"""Stage of a rehearsal: world, stubs, spies and trace."""
