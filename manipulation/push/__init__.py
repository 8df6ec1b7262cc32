"""Pushing of an object over a table, and singulation by pushes."""
