"""pybullet, and how finely it is stepped."""
