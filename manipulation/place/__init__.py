"""Where an object can be put, and what is believed of it then."""
