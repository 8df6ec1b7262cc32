"""Control of the arm: controllers, control loop, safety, wrist sensing, motions in contact."""
