"""Commands that run a mission, and the debugger."""
