"""What a hand does with an object: how to grasp it, where to put it, whether it is held."""
