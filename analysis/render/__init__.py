"""Images of a run, drawn without a display or a GPU."""
