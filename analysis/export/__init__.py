"""A run's log as tables (csv, Parquet) and as a Rerun recording."""
