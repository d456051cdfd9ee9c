"""Test machines other than six turning joints, from their files to their errors.

These would catch: mm of a slide read as degrees, an effect of gears offered for a slide or the reverse, and an
effect of an arm on a track named by the link number. They would also catch a model file that forgets the kind of a
joint, and a benchmark that reaches no floor.

The floor itself, with all machines and seeds, is `python -m tests.benchmarks machines`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import (
    DataError,
    Dataset,
    DiagnosisFit,
    Robot,
    StatedConditions,
    load_model,
    read_dataset,
    save_model,
)
from calib.data import Conditions
from calib.diagnose import diagnose
from calib.effects import LIBRARY, Survey, offers, words_of
from calib.fit import errors_on
from calib.model import ModelStructure, check_effect, conditions_at
from calib.scan import Candidate
from tests.benchmarks.machines import CASES, NOISE_MM, simulated
from tests.calib.machines import machine

CASE = {case.title.partition(",")[0]: case for case in CASES}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("machines")


@pytest.fixture(scope="module")
def track(folder: Path) -> DiagnosisFit:
    return diagnose(simulated(CASE["crooked rail"], 0, folder, 200, 150).dataset)


@pytest.fixture(scope="module")
def scara(folder: Path) -> Dataset:
    return simulated(CASE["scale of the quill"], 0, folder, 120, 80).dataset


def over_floor(dataset: Dataset, found: DiagnosisFit) -> float:
    errors = errors_on(dataset, dataset.validation_rows, found.final.model, found.final.estimate)
    return float(np.sqrt(np.mean(errors**2) / 3.0)) / NOISE_MM


def test_a_crooked_rail_is_named_and_corrected(track: DiagnosisFit) -> None:
    assert [found.effect.label for found in track.effects] == ["slide_straightness:e1"]
    assert (
        over_floor(track.dataset, track) < 1.12
    )  # 450 numbers: 3 % of chance beside what 60 parameters cost


def test_the_scale_of_a_quill_is_named_and_corrected(scara: Dataset) -> None:
    found = diagnose(scara)
    assert [each.effect.label for each in found.effects] == ["slide_scale:j3"]
    value = found.final.estimate[found.final.model.index["slide_scale:j3.scale"]]
    assert value == pytest.approx(1500e-6, rel=0.1)
    assert over_floor(scara, found) < 1.15


def test_a_model_file_keeps_what_its_joints_do(track: DiagnosisFit, folder: Path) -> None:
    save_model(folder / "track.json", track.final)
    robot = load_model(folder / "track.json", robot_file=folder / "track.toml").model.robot
    assert robot == track.final.model.robot
    assert robot.joint_columns[0] == "e1_mm"


def situation(robot: Robot) -> tuple[ModelStructure, Conditions]:
    """A model without effects, and poses under which every effect of a slide does something."""
    model = ModelStructure(robot, (), {"main": {"T": (40.0, 20.0, 90.0)}})
    rng = np.random.default_rng(2)
    joints = rng.uniform(robot.lower, robot.upper, (40, robot.joints)) * 0.9
    drawn = conditions_at(model, joints, StatedConditions(gravity=(1.0, -2.0, -9.5)), "T")
    side = rng.choice([-1.0, 1.0], joints.shape)
    return model, replace(drawn, side=side, temperature=rng.uniform(18.0, 26.0, 40), time=np.arange(40.0))


@pytest.mark.parametrize("name", ["track", "scara", "scara-dh", "gantry", "boom"])
def test_effects_conform_and_are_offered_for_the_joints_they_are_of(name: str, folder: Path) -> None:
    robot = machine(name, folder)
    model, conditions = situation(robot)
    found = offers(Survey(robot, conditions))
    slides = {robot.axes[k - 1] for k in robot.slides}
    joints = {offer.label.split(":")[1] for offer in found if offer.label.startswith("slide_")}
    assert joints == slides
    gears = (
        "periodic",
        "backlash",
        "encoder_scale",
        "joint_step",
        "settling",
        "thermal_joint",
        "lost_motion",
    )
    turned = {offer.label.split(":")[1] for offer in found if offer.label.partition(":")[0] in gears}
    assert turned == set(robot.axes) - slides
    if name == "boom":
        known = {kind.name for entry in LIBRARY for kind in entry.KINDS}
        offered = {offer.label.partition(":")[0] for offer in found}
        assert {kind for kind in known if kind.startswith("slide_")} <= offered
    for offer in found:
        if isinstance(offer, Candidate) and offer.label.startswith(("slide_", "bearing_tilt")):
            check_effect(offer.effect, model, conditions)


def test_effects_of_an_arm_on_a_track_are_called_by_its_joints(folder: Path) -> None:
    robot = machine("track", folder)
    found = {offer.label: offer for offer in offers(Survey(robot, situation(robot)[1]))}
    play = found["backlash:j1"]
    assert isinstance(play, Candidate)
    assert {term.slot for term in play.effect.terms} == {"theta2"}
    assert play.effect.meaning.startswith("Joint 1 ")
    assert play.effect.parameters[0].name == "backlash:j1.gap"
    assert words_of("slide_straightness:e1") == "crooked rail of axis e1"
    assert "coupling:e1-j1" not in found


MISREAD = {
    "degrees of a slide": (lambda text: text.replace("j3_mm", "j3_deg"), "j3_deg", "j3_mm"),
    "mm of a turn": (lambda text: text.replace("j2_deg", "j2_mm"), "j2_mm", "j2_deg"),
    "no unit": (lambda text: text.replace("j3_mm", "j3"), "'j3'", "j3_mm"),
    "metres": (lambda text: text.replace("j3_mm", "j3_m"), "'j3_m'", "j3_mm"),
    "an axis more": (lambda text: text.replace("t_s", "j5_deg"), "j5_deg", "remove"),
}


@pytest.mark.parametrize("case", MISREAD)
def test_columns_of_the_other_kind_are_refused(case: str, scara: Dataset, tmp_path: Path) -> None:
    change, word, remedy = MISREAD[case]
    text = scara.path.read_text("utf-8")
    (tmp_path / "a.csv").write_text(change(text), encoding="utf-8")
    (tmp_path / "a.toml").write_text(scara.path.with_suffix(".toml").read_text("utf-8"), encoding="utf-8")
    machine("scara", tmp_path)
    with pytest.raises(DataError) as caught:
        read_dataset(tmp_path / "a.csv")
    assert word in str(caught.value)
    assert remedy in caught.value.do


@pytest.mark.parametrize(
    ("factor", "word"), [(-1.0, "slides in the other direction"), (0.001, "given in metres")]
)
def test_a_slide_that_means_something_else_is_refused_by_that_name(
    factor: float, word: str, scara: Dataset, tmp_path: Path
) -> None:
    lines = [line.split(",") for line in scara.path.read_text("utf-8").splitlines()]
    for line in lines[1:]:
        line[2] = repr(float(line[2]) * factor)
    (tmp_path / "a.csv").write_text("\n".join(",".join(line) for line in lines) + "\n", encoding="utf-8")
    (tmp_path / "a.toml").write_text(scara.path.with_suffix(".toml").read_text("utf-8"), encoding="utf-8")
    machine("scara", tmp_path)
    with pytest.raises(DataError, match=word) as caught:
        read_dataset(tmp_path / "a.csv")
    assert caught.value.key == "j3_mm"


def test_an_external_axis_that_never_moved_may_stand_beside_an_arm(scara: Dataset, tmp_path: Path) -> None:
    lines = scara.path.read_text("utf-8").splitlines()
    still = [f"{line},{'e1_mm' if i == 0 else '350.0'}" for i, line in enumerate(lines)]
    moved = [f"{line},{'e1_mm' if i == 0 else float(i)}" for i, line in enumerate(lines)]
    (tmp_path / "a.toml").write_text(scara.path.with_suffix(".toml").read_text("utf-8"), encoding="utf-8")
    machine("scara", tmp_path)
    (tmp_path / "a.csv").write_text("\n".join(still) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read_dataset(tmp_path / "a.csv").conditions.joints, scara.conditions.joints)
    (tmp_path / "a.csv").write_text("\n".join(moved) + "\n", encoding="utf-8")
    with pytest.raises(DataError, match="e1_mm"):
        read_dataset(tmp_path / "a.csv")
