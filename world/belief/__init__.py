"""What the robot believes, has tried and has heard."""
