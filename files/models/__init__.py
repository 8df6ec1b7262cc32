"""Documents held against pydantic models."""
