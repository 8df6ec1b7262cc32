"""What is in the hand: whether it is held, what it weighs, whether it slips."""
