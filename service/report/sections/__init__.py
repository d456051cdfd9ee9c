"""The sections of a report: what the template shows in each, as words, rows and figures."""
