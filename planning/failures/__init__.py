"""Why there is no plan: sentences and evidence."""
