"""Validation: what a calibration is worth on readings that took no part in it."""

from calib.validation.compare import Difference, apart, differences, refuse_incomparable
from calib.validation.groups import Grouping
from calib.validation.holdout import HeldOut, hold_outs
from calib.validation.iso9283 import DistanceFigures, PoseFigures
from calib.validation.judge import Judgement, Repeats, judge, judge_repeats, refuse_other_robot
from calib.validation.pairs import pair_errors
from calib.validation.place import place
from calib.validation.summary import Summary, summarise

__all__ = [
    "Difference",
    "DistanceFigures",
    "Grouping",
    "HeldOut",
    "Judgement",
    "PoseFigures",
    "Repeats",
    "Summary",
    "apart",
    "differences",
    "hold_outs",
    "judge",
    "judge_repeats",
    "pair_errors",
    "place",
    "refuse_incomparable",
    "refuse_other_robot",
    "summarise",
]
