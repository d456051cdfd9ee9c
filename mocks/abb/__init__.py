"""A simulated ABB IRC5: RAPID sockets (`mocks.abb.controller`) and simple_message (`mocks.abb.simple`)."""
