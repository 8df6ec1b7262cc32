"""Expected image of everything known: background, robot, hand."""
