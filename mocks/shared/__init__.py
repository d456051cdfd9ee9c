"""Shared parts of the simulated devices: arm, tracker, clocks, the bridge, servers."""
