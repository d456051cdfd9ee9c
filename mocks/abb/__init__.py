"""Simulated ABB IRC5.

It serves RAPID sockets (`mocks.abb.controller`) and simple_message (`mocks.abb.simple`).
"""
