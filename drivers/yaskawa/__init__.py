"""Yaskawa Motoman controllers over the High-Speed Ethernet Server (`drivers.yaskawa.arm`)."""
