"""Reports that need nothing else: one HTML file, no request to anywhere, prints to A4."""

from service.report.build import (
    diagnosis_report,
    identification_report,
    judged_in,
    regression_report,
    validation_report,
)

__all__ = ["diagnosis_report", "identification_report", "judged_in", "regression_report", "validation_report"]
