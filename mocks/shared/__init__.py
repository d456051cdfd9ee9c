"""The parts that simulated devices of several makers share: arm, tracker, clocks, the bridge, servers."""
