"""A simulated QC20-W ballbar behind its bridge."""
