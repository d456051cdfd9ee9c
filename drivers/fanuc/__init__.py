"""Fanuc R-30iA and later: MAPPDK text or Modbus registers (`drivers.fanuc.arm`)."""
