"""Execution of trees: build, tick, debug, adopt edits."""
