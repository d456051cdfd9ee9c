"""Live values of a service for other programs: what an MQTT broker or an OPC UA client reads."""
