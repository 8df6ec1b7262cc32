"""Layout for Foxglove and Lichtblick, made for one log's own tree, topics, joints and cameras."""
