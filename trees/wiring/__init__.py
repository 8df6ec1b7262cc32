"""What is wired to what: which values reach which inputs, over keys and the ports of sub-trees."""
