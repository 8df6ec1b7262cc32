"""The record of a run: what it holds, how it is written, and how it is read."""
