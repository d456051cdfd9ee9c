"""Simulated Leica trackers.

An AT960 behind its bridge (`mocks.leica.bridge`) and an AT901 (`mocks.leica.emscon`).
"""
