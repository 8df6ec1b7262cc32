"""Items that come while a run goes on, and bins that are exchanged."""
