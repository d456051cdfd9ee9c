"""ABB IRC5: RAPID sockets (`drivers.abb.arm`) and ROS-Industrial's simple_message (`drivers.abb.simple`)."""
