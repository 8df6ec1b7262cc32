"""Getting clear of contacts and obstacles, and home."""
