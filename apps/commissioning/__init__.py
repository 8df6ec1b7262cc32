"""Setting up a cell: robot files from URDFs, calibration, plans tried in a scene."""
