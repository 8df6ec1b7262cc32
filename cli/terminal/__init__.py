"""What commands share: output, prompts, progress."""
