"""Events of the journal: one class for each kind, from which log, exports and documents are derived."""
