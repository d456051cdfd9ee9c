"""Control charts of a parameter's history, and the date of the next check."""

from calib.upkeep.chart import ControlChart, Signal, chart_of
from calib.upkeep.due import Check, DriftInterval, Due, InUse, Method, Staircase, next_due

__all__ = [
    "Check",
    "ControlChart",
    "DriftInterval",
    "Due",
    "InUse",
    "Method",
    "Signal",
    "Staircase",
    "chart_of",
    "next_due",
]
