"""Motion planning: requests, collision checks, inverse kinematics, path search, timing and the plan
service."""
