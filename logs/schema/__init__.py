"""Schema of a log: records, topics, JSON Schemas."""
