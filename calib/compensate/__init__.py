"""Compensation: joint targets with which the real robot reaches the nominal pose."""

from calib.compensate.calibrated import Calibrated, Usable, usable
from calib.compensate.carried import (
    RepresentableModel,
    carried,
    constant_slots,
    joint_origins,
    poses_with,
    rigid_frames,
)
from calib.compensate.controller import model_sides, sides_that_move
from calib.compensate.correct import Bounds, correct, inverse_poses, nominal_of, refuse_unlikely
from calib.compensate.correction import REASONS, Correction, Status
from calib.compensate.mounting import Mounting, mounting_of

__all__ = [
    "REASONS",
    "Bounds",
    "Calibrated",
    "Correction",
    "Mounting",
    "RepresentableModel",
    "Status",
    "Usable",
    "carried",
    "constant_slots",
    "correct",
    "inverse_poses",
    "joint_origins",
    "model_sides",
    "mounting_of",
    "nominal_of",
    "poses_with",
    "refuse_unlikely",
    "rigid_frames",
    "sides_that_move",
    "usable",
]
