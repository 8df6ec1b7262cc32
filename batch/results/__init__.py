"""Results of a batch: the database, its tables and views, and their export."""
