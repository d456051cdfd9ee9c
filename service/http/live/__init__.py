"""Live values of a service for MQTT brokers and OPC UA clients."""
