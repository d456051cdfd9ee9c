"""MBP/1, the line protocol of the bridges beside vendors' libraries, whoever made the instrument (docs/bridge.md)."""
