"""Run: missions that are started, watched and steered from the page."""
