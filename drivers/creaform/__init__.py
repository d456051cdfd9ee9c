"""Creaform cameras, behind a bridge (`drivers.creaform.ctrack`)."""
