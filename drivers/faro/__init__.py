"""FARO trackers, behind a bridge (`drivers.faro.ion`)."""
