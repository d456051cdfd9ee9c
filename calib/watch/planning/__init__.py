"""The planning of a watch: where the robot rests, from which sides it comes, how often it is read, what that shows."""
