"""Access to the service: who may ask, in which turn, and who may move the robot."""
