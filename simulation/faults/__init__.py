"""Fault injection: active faults, their schedule and their records."""
