"""Basis of an explanation: the run as a case, its evidence, and the values that come out."""
