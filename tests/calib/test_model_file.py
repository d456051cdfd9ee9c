"""Test `MODEL.json`.

These would catch: a model that predicts otherwise once it was saved, an effect or a unit lost on the way, and
foreign or broken files that are taken for models.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from calib import DataError, Dataset, identify, load_model, read_dataset, save_model
from calib.arm.kinematics import statics
from calib.arm.robot import BUILT_IN, Load
from calib.diagnose import diagnose
from calib.model import BoundModel
from calib.saved import as_saved, save_update
from mocks.campaign import make_campaign
from tests.calib.campaigns import simulate, write_files


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("model")
    _, data = simulate(folder, seed=53, n=100, n_validation=20, effects=["base_shift", "periodic:j6:n101"])
    result = diagnose(data)
    assert len(result.effects) == 2
    save_model(folder / "model.json", result.final, result)
    model = load_model(folder / "model.json")
    predicted = BoundModel(model.model, data.conditions).predict(model.estimate)
    np.testing.assert_allclose(predicted, result.final.predict(data.conditions), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(model.covariance, result.final.covariance, rtol=1e-9)
    assert model.model.effects == result.final.model.effects
    assert model.data_sha256 == data.sha256
    return (folder / "model.json").read_text(encoding="utf-8")


def test_what_it_says(saved: str) -> None:
    document = json.loads(saved)
    assert document["robot"] == "abb-irb120"
    assert document["holds_for"]["approach"] == ["both sides"] * 6
    assert 20.0 < document["holds_for"]["temperature_c"] < 24.0
    assert document["held_out"]["error_mm"]["n"] == 20
    by_name = {p["name"]: p for p in document["parameters"]}
    assert by_name["a3"]["nominal"] == 270.0
    assert by_name["alpha2"]["nominal"] == pytest.approx(-90.0)
    assert by_name["base_shift.x"]["owner"] == "mounting"
    assert by_name["a3"]["unit"] == "mm"
    assert 0.0 < by_name["a3"]["std"] < 0.1


@pytest.mark.parametrize(
    "case", ["missing", "binary", "list", "format", "no effects", "no covariance", "robot"]
)
def test_what_is_no_model_is_refused(case: str, saved: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    document = json.loads(saved)
    if case == "binary":
        path.write_bytes(b"\xff\xfe\x00")
    elif case == "list":
        path.write_text("[]", encoding="utf-8")
    elif case != "missing":
        key = {"format": "format", "no effects": "effects", "no covariance": "covariance_internal_units"}
        if case == "robot":
            document["robot_table"] = "kuka"
        else:
            del document[key[case]]
        path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(DataError) as caught:
        load_model(path)
    assert len(caught.value.do) > 5
    assert str(path) in str(caught.value)


def test_it_holds_the_robot_it_was_fitted_with(tmp_path: Path) -> None:
    """A robot file of the user's own, changed or gone since: the model still predicts as it did."""
    text = (BUILT_IN / "abb-irb120.toml").read_text(encoding="utf-8").replace("a_mm = 270.0", "a_mm = 275.0")
    (tmp_path / "plant7.toml").write_text(
        text.replace('name = "abb-irb120"', 'name = "plant7"'), encoding="utf-8"
    )
    campaign = make_campaign(seed=5, n=60, n_validation=10, effects=[])
    data = read_dataset(write_files(tmp_path, campaign.rows, {**campaign.header, "robot": "plant7.toml"}))
    result = identify(data)
    save_model(tmp_path / "m.json", result)
    (tmp_path / "plant7.toml").unlink()
    back = load_model(tmp_path / "m.json")
    assert back.model.robot == data.header.robot
    assert back.loads == data.header.loads
    np.testing.assert_allclose(
        BoundModel(back.model, data.conditions).predict(back.estimate),
        result.predict(data.conditions),
        atol=1e-9,
    )


def _weighed(dataset: Dataset, *loads: Load) -> Dataset:
    """Return the readings as read with these loads in the header and none in the robot file."""
    header = replace(dataset.header, loads=loads, robot=replace(dataset.header.robot, loads=()))
    there = statics(header.robot, dataset.conditions.joints, loads, header.gravity)
    return replace(
        dataset,
        header=header,
        conditions=replace(
            dataset.conditions, torque=there.torque, moment=there.moment, overturning=there.overturning
        ),
    )


def test_the_compliance_of_a_model_meets_the_loads_it_was_fitted_with(tmp_path: Path) -> None:
    """A later day's header declares no loads, the same tool, another tool, or another arm."""
    _, read = simulate(tmp_path, seed=4, n=80, n_validation=0, effects=[])
    arm = (Load(2, 20.0, (100.0, 0.0, 0.0)), Load(3, 8.0, (60.0, 0.0, 20.0)))
    tool, other = Load(6, 2.0, (0.0, 0.0, 60.0)), Load(6, 1.0, (0.0, 0.0, 40.0))
    found = identify(_weighed(read, *arm, tool), groups=("base", "geometry", "compliance", "tool"))
    saved = as_saved(found)
    torque = _weighed(read, *arm, tool).conditions.torque
    for later in ((), (*arm, tool), (tool,)):
        assert_allclose(saved.loaded(_weighed(read, *later)).conditions.torque, torque)
    with_other = _weighed(read, *arm, other).conditions.torque
    for later in ((*arm, other), (other,)):
        assert_allclose(saved.loaded(_weighed(read, *later)).conditions.torque, with_other)
    with pytest.raises(DataError, match="other masses of link 2 "):
        saved.loaded(_weighed(read, replace(arm[0], mass_kg=25.0), arm[1], tool))
    of_tool = as_saved(identify(_weighed(read, tool), groups=("base", "geometry", "compliance", "tool")))
    with pytest.raises(DataError, match="other masses of link 2, 3 "):
        of_tool.loaded(_weighed(read, *arm, tool))


def test_a_model_that_is_updated_again_keeps_what_was_updated_before(tmp_path: Path) -> None:
    _, read = simulate(tmp_path, seed=4, n=60, n_validation=0, effects=[])
    found, path = identify(read), tmp_path / "m.json"
    save_model(path, found)
    for number in (1, 2):
        save_update(path, path, found.model, found.estimate, found.covariance, {"cause": f"cause {number}"})
    assert [each["cause"] for each in load_model(path).updates] == ["cause 1", "cause 2"]
