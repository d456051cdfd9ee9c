"""Simulated Leica trackers: an AT960 behind its bridge (`mocks.leica.bridge`), an AT901 (`mocks.leica.emscon`)."""
