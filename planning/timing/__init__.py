"""From paths to trajectories within the joints' limits."""
