"""Who may move the robot and who stops it: orders, lease, the lock on a robot."""
