"""Models of drifting and coupled arms, from their diagnosis to a watch.

The tests catch a carried term that is lost in the file or in a correction, and a watch that reports it as a change.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import CalibratedModel, Dataset, load_model, read_dataset, save_model
from calib.compensate import correct
from calib.diagnose import diagnose
from calib.model import named_only
from calib.watch import WhitenedReadings, judge

CASES = Path(__file__).parents[3] / "shared" / "cases" / "drifting_geometry"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason=f"{CASES} is absent")


@pytest.fixture(scope="module", params=["f_couple56_ur", "g_9_step"])
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Dataset, CalibratedModel]:
    path = tmp_path_factory.mktemp("model") / "model.json"
    dataset = read_dataset(CASES / f"{request.param}.csv")
    found = diagnose(dataset)
    save_model(path, found.final, found)
    saved = load_model(path)
    assert saved.model.effects == found.final.model.effects
    assert any(effect.is_carried for effect in saved.model.effects)
    return dataset, saved


def test_what_follows_time_is_left_out_and_what_follows_a_joint_is_used(
    case: tuple[Dataset, CalibratedModel],
) -> None:
    dataset, saved = case
    used, part = saved.for_use()
    of_time = [e.label for e in saved.model.effects if e.is_carried and ":time:" in e.label]
    assert [e.label for e in part.left_out] == of_time
    assert (part.loss is None) == (not of_time)
    done = correct(used.model, used.estimate, dataset.conditions.joints[dataset.fit_rows][:20], used.usual)
    assert done.good.any()
    assert not any(done.beyond[i] for i in np.flatnonzero(done.good))


def test_a_watch_on_its_own_clock_is_quiet_and_needs_the_carried_terms(
    case: tuple[Dataset, CalibratedModel],
) -> None:
    """A watch of twelve poses after the step, on a clock that starts at 0, is quiet.

    The poses are from the second half of the campaign.
    """
    dataset, saved = case
    conditions, rng = dataset.conditions, np.random.default_rng(0)
    late = np.flatnonzero(dataset.usable & (conditions.time > np.quantile(conditions.time, 0.55)))
    model, estimate, covariance = named_only(saved.model, saved.estimate, saved.covariance)
    named = replace(
        saved, model=model, estimate=estimate, covariance=covariance, held_std=None, left_open=None
    )
    for _ in range(3):
        poses = rng.choice(np.unique(conditions.pose[late]), 12, replace=False)
        rows = late[np.isin(conditions.pose[late], poses)]
        time = conditions.time.copy()
        time[rows] -= time[rows].min()
        sets = np.where(np.isin(np.arange(len(dataset)), rows), "calibration", "validation")
        later = replace(dataset, conditions=replace(conditions, time=time), sets=sets)
        assert judge(WhitenedReadings.of(saved, later)).kind == "unchanged"
        assert judge(WhitenedReadings.of(named, later)).kind == "unexplained"
