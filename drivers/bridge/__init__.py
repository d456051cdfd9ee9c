"""MBP/1, the line protocol of the bridges to vendors' libraries, for instruments of all makers (docs/bridge.md)."""
