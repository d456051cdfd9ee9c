"""Self-contained reports: one HTML file without requests, printable on A4."""

from service.report.build import (
    diagnosis_report,
    identification_report,
    judged_in,
    regression_report,
    validation_report,
)

__all__ = ["diagnosis_report", "identification_report", "judged_in", "regression_report", "validation_report"]
