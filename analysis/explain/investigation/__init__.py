"""What an explanation goes by: the run as a case, its evidence, and the values that come out."""
