"""Running one mission: assembling, ticking, recording, checkpoints, edits, going on."""
