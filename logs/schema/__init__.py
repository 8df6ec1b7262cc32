"""What a log holds: records, topics, JSON Schemas."""
