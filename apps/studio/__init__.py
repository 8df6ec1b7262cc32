"""Studio: a local web application over a folder with missions, scenes, plans and runs."""
