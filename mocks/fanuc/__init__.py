"""A simulated Fanuc: its controller, and the wires MAPPDK, Modbus TCP and RMI."""
