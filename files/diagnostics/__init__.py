"""Faults in files: their codes and pages, how they are shown, silenced and gathered."""
