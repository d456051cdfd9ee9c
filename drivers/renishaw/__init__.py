"""Renishaw ballbars, behind a bridge (`drivers.renishaw.qc20w`), and the files of its own program (`b5r`)."""
