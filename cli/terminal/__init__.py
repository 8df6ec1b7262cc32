"""Terminal functions shared by commands: output, prompts, progress."""
