"""Fanuc R-30iA and later: MAPPDK text, Modbus registers or RMI (`drivers.fanuc.arm`)."""
