"""Runs of the folder: index, opening, explanation, what-if and comparison."""
