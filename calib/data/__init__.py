"""Data sets: header, readings and their conditions, and checks of plausibility."""

from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.header import (
    ABSOLUTE_ACCURACY,
    DEFAULT_GROUPS,
    GROUPS,
    LEAST,
    LEVELS,
    Header,
    header_of,
    read_header,
    read_noise,
)
from calib.data.hypotheses import FEWEST as FEWEST_MEANT
from calib.data.hypotheses import Hypothesis, InterpretedReadings, explained, of_points, of_robot
from calib.data.joints_misread import of_directions, of_joints
from calib.data.noise import Noise
from calib.data.plausible import assumed_in_words
from calib.data.read import dataset_of, read_dataset
from calib.data.spans import OTHER, Span

__all__ = [
    "ABSOLUTE_ACCURACY",
    "DEFAULT_GROUPS",
    "FEWEST_MEANT",
    "GROUPS",
    "LEAST",
    "LEVELS",
    "OTHER",
    "Conditions",
    "Dataset",
    "Header",
    "Hypothesis",
    "InterpretedReadings",
    "Noise",
    "Span",
    "assumed_in_words",
    "dataset_of",
    "explained",
    "header_of",
    "of_directions",
    "of_joints",
    "of_points",
    "of_robot",
    "read_dataset",
    "read_header",
    "read_noise",
]
