"""Robot setup: proposes a robot file from a URDF, and summarises robot files."""
