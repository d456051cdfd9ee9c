"""A simulated Universal Robots controller: its streams, RTDE, URScript and servo."""
