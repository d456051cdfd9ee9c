"""A simulated Fanuc: its controller, and the wires MAPPDK and Modbus TCP."""
