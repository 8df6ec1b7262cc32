"""Control loop, and the arm's and gripper's motions as generators on it."""
