"""The right to move the robot, and to stop it: orders, lease, and the lock on a robot."""
