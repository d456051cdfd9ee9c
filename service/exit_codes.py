"""Exit codes of every command."""

from __future__ import annotations

DONE = 0
FAILED = 1
USAGE = 2  # wrong command line, or input that cannot be used
NOT_MET = 3  # done, but the accuracy asked for was not met
NOT_AVAILABLE = 4  # operator or device
REFUSED = 5  # for safety
UNKNOWN_CAUSE = 6  # a watch: the robot has changed, and no single cause is known
INTERRUPTED = 130
