"""Test that forged model files are refused.

These would catch: a parameter that is listed twice, a joint turned by 10 deg, another robot's name, wider limits, a
number changed by hand, and shapes that cause an internal error.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calib import DataError, identify, load_model, load_robot, save_model
from calib.arm.robot import BUILT_IN
from calib.compensate import Bounds
from calib.saved import SIMULATED
from calib.saved.model_checks import content_hash
from tests.calib.campaigns import simulate

Document = dict[str, Any]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("model")
    _, data = simulate(folder, seed=53, n=60, n_validation=10)
    save_model(folder / "m.json", identify(data))
    return (folder / "m.json").read_text("utf-8")


def resealed(document: Document, path: Path) -> Path:
    """Write a file with a matching hash, as an expert could: a hash is no signature."""
    document["content_sha256"] = content_hash(document)
    path.write_text(json.dumps(document), "utf-8")
    return path


def parameter(document: Document, name: str) -> Document:
    return next(entry for entry in document["parameters"] if entry["name"] == name)


def effect(document: Document, label: str) -> Document:
    return next(entry for entry in document["effects"] if entry["label"].startswith(label))


def set_to(*keys: Any, value: Any) -> Callable[[Document], object]:
    def change(document: Document) -> None:
        at: Any = document
        for key in keys[:-1]:
            at = at[key]
        at[keys[-1]] = value

    return change


def add(name: str, deg: float) -> Callable[[Document], object]:
    def change(document: Document) -> None:
        parameter(document, name)["value"] += deg

    return change


def term(key: str, value: Any) -> Callable[[Document], object]:
    return lambda document: effect(document, "geometry")["terms"][0].update({key: value})


BELIEVED: dict[str, tuple[Callable[[Document], object], str]] = {
    "a parameter twice": (
        lambda d: d["parameters"].append(parameter(d, "theta2") | {"value": 23.0}),
        "parameters.theta2.*twice",
    ),
    "an unknown parameter": (
        lambda d: d["parameters"].append(parameter(d, "theta2") | {"name": "theta9"}),
        "parameters.theta9",
    ),
    "a parameter left out": (lambda d: d["parameters"].pop(), "parameters.*missing"),
    "a parameter in another unit": (lambda d: parameter(d, "theta2").update(unit="mrad"), "theta2.*mrad"),
    "a parameter of text": (lambda d: parameter(d, "theta2").update(value="1"), "theta2"),
    "theta6 + 2.001 deg": (
        add("theta6", 2.001),
        r"up to 2\.[0-9]+ deg, more than 2 deg; most of it by",
    ),
    "theta2 + 10 deg": (add("theta2", 10.0), "theta2.*largest-correction"),
    "theta6 + 3 deg, which turns the flange and shifts nothing": (add("theta6", 3.0), "theta6"),
    "a2 + 20 mm": (add("a2", 20.0), "a2.*22"),
    "a weight of 1e6": (term("weight", 1e6), "corrects the robot"),
    "another robot's name": (set_to("robot", value="ur5"), "'ur5'"),
    "another robot's name twice": (
        lambda d: (d.update(robot="ur5"), d["robot_table"].update(name="ur5"), d.pop("robot_sha256")),
        "not 'ur5'",
    ),
    "another robot's hash": (set_to("robot_sha256", value="0" * 64), "robot"),
    "wider limits": (
        lambda d: (d["robot_table"]["upper"].__setitem__(1, 3.1), d.pop("robot_sha256")),
        "upper limit of joint 2 is 177.6.* deg, in the robot file 110 deg",
    ),
    "a longer link": (
        lambda d: (d["robot_table"]["a"].__setitem__(2, 280.0), d.pop("robot_sha256")),
        "robot_table.a",
    ),
    "a link longer by 0.05 mm": (
        lambda d: (d["robot_table"]["a"].__setitem__(2, 270.05), d.pop("robot_sha256")),
        "robot_table.a",
    ),
    "an effect with a parameter twice": (
        lambda d: effect(d, "geometry")["parameters"].append(effect(d, "geometry")["parameters"][0]),
        "given twice",
    ),
    "a joint that is not there": (term("regressor", {"kind": "JointAngle", "joint": 7}), "joint = 7"),
    "a joint of text": (term("regressor", {"kind": "JointAngle", "joint": "1"}), "joint = '1'"),
    "an unknown regressor": (term("regressor", {"kind": "Magic"}), "Magic"),
    "an unknown slot": (term("slot", "theta9"), "theta9"),
    "an unknown unit": (lambda d: effect(d, "geometry")["parameters"][0].update(unit="ell"), "ell"),
    "a series that is not there": (term("regressor", {"kind": "InSeries", "series": "x"}), "series = 'x'"),
    "effects of text": (set_to("effects", value="many"), "damaged"),
    "a list of links too short": (lambda d: d["robot_table"]["d"].pop(), "robot_table"),
    "a mirrored base": (
        lambda d: d.update(placements={"main": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}),
        "placements.main",
    ),
    "a covariance of one row": (set_to("covariance_internal_units", value=[[1.0]]), "covariance"),
    "a covariance of text": (set_to("covariance_internal_units", value="none"), "covariance"),
    "no series": (set_to("tool_targets_mm", value={}), "series"),
    "a target of two numbers": (set_to("tool_targets_mm", value={"main": {"T1": [0, 1]}}), "main.T1"),
    "a load on link 9": (lambda d: d["loads"][0].update(link=9), "load"),
    "gravity of text": (set_to("gravity_base", value="down"), "gravity_base"),
    "an approach of one joint": (set_to("holds_for", "approach", value=["from below"]), "approach"),
    "air of text": (set_to("holds_for", "temperature_c", value="warm"), "temperature_c"),
    "an unknown coupling": (set_to("joint_coupling", value="fanuc-j23"), "joint_coupling"),
}


@pytest.mark.parametrize("case", sorted(BELIEVED))
def test_what_a_file_says_is_not_believed_though_its_hash_is_right(
    case: str, written: str, tmp_path: Path
) -> None:
    change, words = BELIEVED[case]
    document = json.loads(written)
    change(document)
    path = resealed(document, tmp_path / "m.json")
    with pytest.raises(DataError, match=words) as caught:
        load_model(path)
    assert str(path) in str(caught.value)
    assert len(caught.value.do) > 5


def test_a_file_changed_by_hand_is_noticed(written: str, tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    document = json.loads(written)
    path.write_text(json.dumps(document, indent=4, sort_keys=True), "utf-8")  # only laid out in another way
    assert load_model(path).notes == (SIMULATED,)
    parameter(document, "theta2")["value"] += 1e-4
    path.write_text(json.dumps(document), "utf-8")
    with pytest.raises(DataError, match=r"content_sha256.*changed"):
        load_model(path)


def test_a_file_of_an_older_version_is_read_and_said_to_be_one(written: str, tmp_path: Path) -> None:
    document = json.loads(written)
    del document["content_sha256"], document["robot_sha256"], document["robot_table"]["capsules"]
    (tmp_path / "m.json").write_text(json.dumps(document), "utf-8")
    saved = load_model(tmp_path / "m.json")
    _, note = saved.notes
    assert "older version" in note
    assert saved.model.robot == load_robot("abb-irb120")


def test_a_key_that_stands_twice_is_refused(written: str, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(written.rstrip()[:-1] + ', "parameters": []}', "utf-8")
    with pytest.raises(DataError, match=r"parameters.*twice"):
        load_model(tmp_path / "m.json")


def test_larger_corrections_are_taken_when_they_are_allowed(written: str, tmp_path: Path) -> None:
    document = json.loads(written)
    parameter(document, "theta2")["value"] += 3.0
    path = resealed(document, tmp_path / "m.json")
    with pytest.raises(DataError, match="theta2"):
        load_model(path, bounds=Bounds(turn_deg=2.0, shift_mm=100.0))
    assert load_model(path, bounds=Bounds(turn_deg=5.0, shift_mm=100.0)).notes == (SIMULATED,)


def test_a_robot_of_ones_own(written: str, tmp_path: Path) -> None:
    """A custom robot's table is accepted by name, with a note; with its file both must agree."""
    document = json.loads(written)
    document["robot"] = document["robot_table"]["name"] = "plant7"
    path = resealed(document, tmp_path / "m.json")
    _, note = load_model(path).notes
    assert "plant7" in note
    text = (BUILT_IN / "abb-irb120.toml").read_text("utf-8")
    own = tmp_path / "plant7.toml"
    own.write_text(text.replace('name = "abb-irb120"', 'name = "plant7"'), "utf-8")
    assert load_model(path, robot_file=own).notes == (SIMULATED,)
    own.write_text(text.replace("max_deg = 110.0", "max_deg = 90.0"), "utf-8")
    with pytest.raises(DataError, match="upper limit of joint 2 is 110 deg, in the robot file 90 deg"):
        load_model(path, robot_file=own)
