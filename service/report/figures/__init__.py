"""The figures of a report, each drawn from results alone, and the look that they share."""
