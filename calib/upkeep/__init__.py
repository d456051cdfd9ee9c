"""Control charts of a parameter's history, and the date of the next check."""

from calib.upkeep.chart import ControlChart, Signal, chart_of
from calib.upkeep.check import Check
from calib.upkeep.drift import Drift
from calib.upkeep.due import Due, Method, next_due
from calib.upkeep.in_use import InUse
from calib.upkeep.staircase import Staircase

__all__ = [
    "Check",
    "ControlChart",
    "Drift",
    "Due",
    "InUse",
    "Method",
    "Signal",
    "Staircase",
    "chart_of",
    "next_due",
]
