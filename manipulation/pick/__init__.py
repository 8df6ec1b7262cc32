"""Pick-and-place candidates in a ranked stream, their requests, and visual servoing of the grasp."""
