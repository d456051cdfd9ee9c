"""Leica trackers, behind a bridge (`drivers.leica.at960`) or over emScon packets (`emscon`)."""
