"""ABB IRC5 over RAPID sockets (`drivers.abb.arm`) or simple_message (`drivers.abb.simple`)."""
