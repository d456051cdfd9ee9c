"""Validation: the errors of a calibration on held-out readings."""

from calib.validation.ballbar import SphereTest, over_the_fixture, sphere_tests
from calib.validation.compare import Difference, apart, differences, refuse_incomparable
from calib.validation.holdout import HoldOutErrors, hold_outs
from calib.validation.iso9283 import VISITS_OF_THE_STANDARD, DistanceFigures, PoseFigures
from calib.validation.judge import Grouping, Judgement, Repeats, judge, judge_repeats, refuse_other_robot
from calib.validation.place import balls_of, halved, knows_ends, of_the_robot, place, targets_in_base
from calib.validation.summary import Summary

__all__ = [
    "VISITS_OF_THE_STANDARD",
    "Difference",
    "DistanceFigures",
    "Grouping",
    "HoldOutErrors",
    "Judgement",
    "PoseFigures",
    "Repeats",
    "SphereTest",
    "Summary",
    "apart",
    "balls_of",
    "differences",
    "halved",
    "hold_outs",
    "judge",
    "judge_repeats",
    "knows_ends",
    "of_the_robot",
    "over_the_fixture",
    "place",
    "refuse_incomparable",
    "refuse_other_robot",
    "sphere_tests",
    "targets_in_base",
]
