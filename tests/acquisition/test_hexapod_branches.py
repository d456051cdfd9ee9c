"""Arm branches of the stances of the legs.

These would catch: flip and noflip that do not take turns, a branch that the block does not name, and validation poses
that were used in the fit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.campaign.plan import make_plan
from acquisition.cell.cell import read_cell
from calib.arm import forward
from calib.validation.judge import branches as branches_of
from drivers.errors import ConfigError
from tests.acquisition.fakes import BALLBAR, a_campaign, a_cell

LR_MATE = Path(__file__).parents[2] / "examples" / "lrmate_ballbar" / "cell.toml"


def test_branches_take_turns_and_are_those_that_the_block_names() -> None:
    cell = a_cell(**BALLBAR)

    def named(**block: Any) -> list[str]:
        visits = make_plan(cell, a_campaign(block=[{"kind": "hexapod"} | block]))
        joints = np.array([visit.joints_deg for visit in visits])
        return list(branches_of(cell.robot.model, cell.robot.model_angles(joints)) or ())

    alone, mixed = named(branches=["front/up"]), named(branches=["front/up"], configurations="mixed")
    assert len(alone) == len(mixed)  # one configuration a stance, whichever
    assert set(mixed) == {"front/up/noflip", "front/up/flip"}
    assert abs(mixed.count("front/up/flip") - mixed.count("front/up/noflip")) <= 2
    cell = read_cell(LR_MATE)
    both = named(branches=["front/up", "back/down"], configurations="all")
    assert {name.rpartition("/")[0] for name in both} == {"front/up", "back/down"}
    assert {name.rpartition("/")[0] for name in named(branches=["back/down"])} == {"back/down"}
    with pytest.raises(ConfigError, match=r"branches': names 'front/dow'\. Name branches of the arm"):
        make_plan(cell, a_campaign(block=[{"kind": "hexapod", "branches": ["front/dow"]}]))


def test_poses_to_judge_by_are_other_stances_than_those_fitted_to() -> None:
    cell = a_cell(**BALLBAR)
    fitted = {"kind": "hexapod", "set": "calibration", "configurations": "mixed", "count": 15}
    judged = {"kind": "hexapod", "set": "validation", "configurations": "all", "count": 8}
    visits = make_plan(cell, a_campaign(block=[fitted, judged]))
    flange = forward(
        cell.robot.model, cell.robot.model_angles(np.array([visit.joints_deg for visit in visits]))
    )
    of_fit = np.array([visit.set == "calibration" for visit in visits])
    assert (int(of_fit.sum()), int((~of_fit).sum())) == (15, 8)
    apart = np.abs(flange[of_fit][:, None] - flange[~of_fit][None]).max(axis=(2, 3))
    assert apart.min() > 1.0  # no stance of the fit, in whichever branch


def test_where_no_other_stance_is_left_other_branches_judge() -> None:
    cell = a_cell(**BALLBAR)
    every = {"kind": "hexapod", "set": "calibration"}
    visits = make_plan(
        cell, a_campaign(block=[every, every | {"set": "validation", "configurations": "all"}])
    )
    of_fit = {visit.joints_deg for visit in visits if visit.set == "calibration"}
    judged = [visit.joints_deg for visit in visits if visit.set == "validation"]
    assert judged
    assert not of_fit & set(judged)
