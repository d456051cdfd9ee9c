"""Pictures of the report: every label of the library over what drives it, structure where it lives, advice for each.

These would catch: a kind of effect without a picture that convinces, an axis or a sign that does not belong to the law
that is drawn, and structure drawn in the wrong place.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset import Dataset, read_dataset
from calib.diagnose.select import refit
from calib.effects import Candidate, Harmonics, Shapes, Survey, offers
from calib.effects.effect import Effect
from calib.effects.gear_curve import gear_curve
from calib.identification import Identification
from calib.identify import identify
from calib.statistics import statistics_of
from service.advice import CHECKS
from service.report import gains, structure
from service.report.panels import Panel, of_effect, of_joint
from service.report.residuals import Sample
from service.report.scatter import effect_figure
from tests.service.campaigns import edit_text, write_data

DEFAULT = ["base", "geometry", "parallel_twist", "compliance"]
PICTURES = {
    "backlash:j4": "θ4, deg",
    "periodic:j2:n3": "θ2, deg",
    "encoder_scale:j6": "θ6, deg",
    "coupling:j4-j5": "θ4, deg",
    "dead_zone:j5": "gravity torque of joint 5, N·m",
    "cubic_stiffness:j3": "gravity torque of joint 3, N·m",
    "settling:j5": "last move of joint 5, deg",
    "thermal_joint:j2": "air temperature, °C",
    "thermal_growth": "air temperature, °C",
    "warm_up": "time, h",
    "link_torsion:j3": "gravity moment at joint 3, N·m",
    "bearing_tilt:j4": "displacement by the fitted law, mm",
    "pedestal": "displacement by the fitted law, mm",
    "payload_mass": "displacement by the fitted law, mm",
    "payload_cog": "displacement by the fitted law, mm",
    "target_offset:T2": "reading, in order of time",
    "tracker_scale": "displacement by the fitted law, mm",
    "drift_translation": "time, h",
    "drift_rotation": "time, h",
}
WITHOUT = {  # what the default base model holds already -> the groups without it
    "joint_offset:j3": ["base"],
    "joint_compliance:j2": ["base", "geometry", "parallel_twist"],
    "parallel_twist:j3": ["base", "geometry", "compliance"],
}


def proposed(label: str, survey: Survey) -> Effect:
    """The effect of a label as the library offers it, scanned constants near those of the simulation."""
    for offer in offers(survey):
        if isinstance(offer, Candidate) and offer.label == label:
            return offer.effect
        if isinstance(offer, Harmonics) and label.startswith(f"{offer.label}:n"):
            return offer.at(float(label.rpartition("n")[2]))
        if isinstance(offer, Shapes) and offer.label == label:
            return offer.at(float(np.median(offer.values)))
    raise AssertionError(f"{label} is not offered")


def fitted(
    label: str, folder: Path, groups: list[str] | None = None
) -> tuple[Dataset, Identification, Effect]:
    """Readings that hide an effect, and the model that has it."""
    data = write_data(folder, effects=(label,), n=150)
    if groups is not None:
        wrong, right = (str(names).replace("'", '"') for names in (DEFAULT, groups))
        edit_text(data.with_suffix(".toml"), _lines(wrong), right)
    dataset = read_dataset(data)
    base = identify(dataset)
    effect = proposed(label, Survey.of(base, dataset))
    return dataset, refit(dataset, base, (effect,)), effect


def _lines(names: str) -> str:
    return "[\n    " + names.strip("[]").replace(", ", ",\n    ") + ",\n]"


def slope(panel: Panel) -> float:
    """Of the dots against the lines, each side of approach on its own line: 1 where readings follow the law."""
    top = bottom = 0.0
    for x, y, side in panel.lines:
        mine = panel.clear & ~panel.held
        if panel.side is not None:
            mine &= panel.side == side
        known = np.isfinite(y)
        law = np.interp(panel.x[mine], x[known], y[known])
        top += float(np.sum(law * panel.y[mine] / panel.sd[mine] ** 2))
        bottom += float(np.sum((law / panel.sd[mine]) ** 2))
    return top / bottom


@pytest.mark.parametrize("label", PICTURES)
def test_readings_follow_the_law_over_what_drives_it(label: str, tmp_path: Path) -> None:
    dataset, final, effect = fitted(label, tmp_path)
    panel = of_effect(Sample.of(dataset, final), effect)
    assert panel.x_label == PICTURES[label]
    assert slope(panel) == pytest.approx(1.0, abs=0.15)
    assert "<svg" in effect_figure(panel, "effect1")


@pytest.mark.parametrize("label", WITHOUT)
def test_what_the_base_model_lacks_has_a_picture(label: str, tmp_path: Path) -> None:
    dataset, final, effect = fitted(label, tmp_path, WITHOUT[label])
    panel = of_effect(Sample.of(dataset, final), effect)
    assert np.ptp(panel.x) > 0.0
    assert np.all(np.isfinite(panel.y))
    assert "<svg" in effect_figure(panel, "effect1")


def test_a_curve_is_drawn_over_the_angle(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, effects=("periodic:j4:n5",), n=300))
    base = identify(dataset)
    angle = base.readings.conditions.joints[:, 3]
    curve = gear_curve(4, float(angle.min()), float(angle.max()), 0.2)
    sample = Sample.of(dataset, refit(dataset, base, (curve,)))
    panel = of_effect(sample, curve)
    assert panel.x_label == "θ4, deg"
    assert slope(panel) == pytest.approx(1.0, abs=0.15)
    (x, y, _), (_, of_all, _) = panel.lines[0], of_joint(sample, 4, (curve,)).lines[0]
    known = np.isfinite(y)
    assert np.ptp(y[known]) > 10.0
    np.testing.assert_allclose(y[known], of_all[known])
    assert x.size == y.size


def test_every_label_of_the_library_comes_with_advice(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path))
    survey = Survey.of(identify(dataset), dataset)
    names = {offer.label.partition(":")[0] for offer in offers(survey)}
    names |= {label.partition(":")[0] for label in (*PICTURES, *WITHOUT)} | {"gear_curve", "tool_tilt"}
    assert names <= set(CHECKS)


def test_the_error_without_an_effect_is_that_of_the_base_model(tmp_path: Path) -> None:
    """To first order: leaving one effect out of the fit must give what a fit without it gives."""
    data = write_data(tmp_path, effects=("periodic:j2:n3", "backlash:j5"), n=200)
    dataset = read_dataset(data)
    base = identify(dataset)
    survey = Survey.of(base, dataset)
    one, other = proposed("periodic:j2:n3", survey), proposed("backlash:j5", survey)
    both, alone = refit(dataset, base, (one, other)), refit(dataset, base, (other,))
    rows = dataset.validation_rows
    left = np.linalg.norm(alone.predict(dataset.conditions.take(rows)) - dataset.points[rows], axis=1)
    expected, got = statistics_of(left), gains.error_without(dataset, both, one)
    assert expected is not None
    assert got is not None
    assert got.rms == pytest.approx(expected.rms, rel=0.01)


@pytest.mark.parametrize(
    "where", ["joint 3 angle", "time", "tool target", "region of the workspace", "somewhere"]
)
def test_structure_is_drawn_where_it_lives(where: str, tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, effects=("outside:workspace_field",), n=150))
    sample = Sample.of(dataset, identify(dataset))
    picture = structure.picture_of(where, 1, dataset, sample)
    if where == "somewhere":
        assert picture is None
    else:
        assert picture is not None
        assert picture.startswith("<svg")
        assert 'id="left1-' in picture


def test_residual_vectors_are_measured_less_predicted(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, n=60))
    final = identify(dataset)
    sample = Sample.of(dataset, final)
    left = sample.left(dataset)
    rows = final.readings.rows
    expected = dataset.points[rows] - final.predict(dataset.conditions.take(rows))
    np.testing.assert_allclose(left[: len(rows)], expected)
    assert len(left) == len(rows) + int(dataset.validation_rows.sum())
