"""The stage of a rehearsal: its world, its stand-ins, its trace."""
