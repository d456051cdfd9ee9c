"""MBP/1, the line protocol of the bridges to vendors' libraries (docs/bridge.md).

It serves instruments of all makers.
"""
