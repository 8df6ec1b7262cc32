"""Commands that set up a cell: robot files, calibration, trial plans."""
