"""What a picture should show of all that is known: background, robot, hand."""
