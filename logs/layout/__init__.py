"""A layout of Foxglove and Lichtblick for one log."""
