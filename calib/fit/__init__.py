"""Identification of the base model by robust least squares, with its uncertainty."""

from calib.fit.circle_points import FEWEST, LEAST_RANGE
from calib.fit.held_out import (
    ExcludedReading,
    HeldOutFault,
    HeldOutFaults,
    all_readings,
    errors_on,
    left_out,
    length_differences,
)
from calib.fit.identification import IdentificationFit, expanded, radius_95
from calib.fit.identify import identify, silent
from calib.fit.offsets import TargetOffset, judge_points, offsets_of
from calib.fit.placing import base_model_of, place_nominal
from calib.fit.readings import FitReadings, readings_of
from calib.fit.statistics import ErrorStatistics, statistics_of, worse
from calib.fit.uncertainty_map import UncertaintyMap, uncertainty_map

__all__ = [
    "FEWEST",
    "LEAST_RANGE",
    "ErrorStatistics",
    "ExcludedReading",
    "FitReadings",
    "HeldOutFault",
    "HeldOutFaults",
    "IdentificationFit",
    "TargetOffset",
    "UncertaintyMap",
    "all_readings",
    "base_model_of",
    "errors_on",
    "expanded",
    "identify",
    "judge_points",
    "left_out",
    "length_differences",
    "offsets_of",
    "place_nominal",
    "radius_95",
    "readings_of",
    "silent",
    "statistics_of",
    "uncertainty_map",
    "worse",
]
