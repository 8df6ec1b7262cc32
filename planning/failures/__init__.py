"""Planning failures: causes, sentences and evidence."""
