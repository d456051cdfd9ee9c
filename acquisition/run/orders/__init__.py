"""The right to move the robot, and to stop it: orders, lease, the lock on a robot."""
