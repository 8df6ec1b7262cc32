"""Calibrating as a job: a run that looks and touches, an estimate from its log, a scene that believes it."""
