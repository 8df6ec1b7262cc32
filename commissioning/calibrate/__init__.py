"""Calibration job: a run that looks and touches, an estimate from its log, a corrected scene file."""
