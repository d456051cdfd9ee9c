"""Additions to Sphinx for the site of the documentation."""
