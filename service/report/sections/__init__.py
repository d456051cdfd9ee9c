"""The sections of a report: text, rows and figures for the template."""
