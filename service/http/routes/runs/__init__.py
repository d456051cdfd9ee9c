"""Routes of what moves the robot: runs, their plans and prompts, closed loops."""
