"""Renishaw ballbars behind a bridge (`qc20w`), and files of the maker's software (`b5r`)."""
