"""A simulated Yaskawa controller: its High-Speed Ethernet Server and the jobs that it runs."""
