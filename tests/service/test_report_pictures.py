"""Pictures of the report.

Every label of the library has a picture over its driving quantity; residual structure is drawn in its place, with
advice. These would catch: a kind of effect without a convincing picture, an axis or a sign that does not belong to the
drawn law, and structure drawn in the wrong place.
"""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from calib import Dataset, IdentificationFit, identify, read_dataset
from calib.diagnose import ACTS_ON, EACH_POSE, QUICK, SEEN, TOGETHER, ResidualStructure, errors_without
from calib.diagnose.select import refit
from calib.diagnose.structure import drivers
from calib.effects import Survey, offers
from calib.effects.transmission import BANDS, gear_orders
from calib.fit import statistics_of
from calib.model import Effect, effect
from calib.model.regressors import ApproachSide
from calib.scan import Candidate, Harmonics, Shapes, Space
from calib.units import DEG
from service.report.figures import drawing, structure
from service.report.figures.drawing import FITTED
from service.report.figures.panels import PlotPanel, of_effect, of_joint
from service.report.figures.quantities import quantity_of
from service.report.figures.residuals import PlotSample
from service.report.figures.scatter import effect_figure
from service.wording import structure_caption
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
    """Return the effect of a label as the library offers it.

    Scanned constants are near those of the simulation.
    """
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
) -> tuple[Dataset, IdentificationFit, Effect]:
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


def slope(panel: PlotPanel) -> float:
    """Fit the slope of the dots against the lines, with a separate line per side of approach.

    The slope is 1 if the readings follow the law.
    """
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
    panel = of_effect(PlotSample.of(dataset, final), effect)
    assert panel.x_label == PICTURES[label]
    assert slope(panel) == pytest.approx(1.0, abs=0.15)
    assert "<svg" in effect_figure(panel, "effect1")


@pytest.mark.parametrize("label", WITHOUT)
def test_what_the_base_model_lacks_has_a_picture(label: str, tmp_path: Path) -> None:
    dataset, final, effect = fitted(label, tmp_path, WITHOUT[label])
    panel = of_effect(PlotSample.of(dataset, final), effect)
    assert np.ptp(panel.x) > 0.0
    assert np.all(np.isfinite(panel.y))
    assert "<svg" in effect_figure(panel, "effect1")


def test_the_curve_of_a_gear_is_drawn_over_a_turn_with_its_band(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, effects=("periodic:j4:n5",), n=300))
    base = identify(dataset)
    angle = base.readings.conditions.joints[:, 3]
    curve = gear_orders(4, np.where(np.arange(BANDS) < 7, 0.02, 1e-5))
    sample = PlotSample.of(dataset, refit(dataset, base, (curve,)))
    panel = of_effect(sample, curve)
    assert panel.x_label == "θ4, deg"
    assert slope(panel) == pytest.approx(1.0, abs=0.15)
    (x, y, _), band = panel.lines[0], panel.band
    assert band is not None
    assert np.ptp(x) == pytest.approx(360.0)
    known = (x > angle.min() / DEG) & (x < angle.max() / DEG)
    room = band[2] - band[1]
    assert np.median(room[~known]) > 2.0 * np.median(room[known]), "where no reading was, nobody knows"
    assert np.all((band[1] < y) & (y < band[2]))
    assert "k = 2" in effect_figure(panel, "effect1")
    of_all = of_joint(sample, 4, (curve,)).lines[0]
    drawn = np.isfinite(of_all[1])
    np.testing.assert_allclose(of_all[1][drawn], np.interp(of_all[0][drawn], x, y), atol=0.2)


def test_a_law_with_two_sides_has_a_line_for_each_wherever_it_acts(tmp_path: Path) -> None:
    """A lash acts on another slot than a joint's angle.

    No kind of the library has such a lash, so only the regressor states its two sides.
    """
    dataset = read_dataset(write_data(tmp_path, effects=("backlash:j4",), n=150))
    base = identify(dataset)
    lash = effect(
        "lash:j4",
        "transmission",
        "robot",
        "Joint 4 leans to the side from which it comes.",
        {"lean": ("deg", 0.02, [("alpha4", ApproachSide(4))])},
    )
    panel = of_effect(PlotSample.of(dataset, refit(dataset, base, (lash,))), lash)
    assert panel.x_label == "θ4, deg"
    assert panel.side is not None
    assert [side for _, _, side in panel.lines] == [1.0, -1.0]
    above, below = (heights for _, heights, _ in panel.lines)
    np.testing.assert_allclose(above, -below[0])


def test_the_error_without_an_effect_is_that_of_the_base_model(tmp_path: Path) -> None:
    """A fit without the effect must give the same error, to first order."""
    data = write_data(tmp_path, effects=("periodic:j2:n3", "backlash:j5"), n=200)
    dataset = read_dataset(data)
    base = identify(dataset)
    survey = Survey.of(base, dataset)
    one, other = proposed("periodic:j2:n3", survey), proposed("backlash:j5", survey)
    both, alone = refit(dataset, base, (one, other)), refit(dataset, base, (other,))
    rows = dataset.validation_rows
    left = np.linalg.norm(alone.predict(dataset.conditions.take(rows)) - dataset.points[rows], axis=1)
    expected, got = statistics_of(left), errors_without(dataset, both, [one])[0]
    assert expected is not None
    assert got is not None
    assert got.rms == pytest.approx(expected.rms, rel=0.01)


PLACES = {
    "joint 3 angle": "θ3, deg",
    "joint 2 and joint 5 angles": "θ5, deg",
    "side of approach of joint 4": "arrived from above",
    "last change of torque about joint 2": "change of torque in the last move, N.m",
    "moment across joint 3": "moment across the joint, N.m",
    "time": "time, h",
    QUICK: "reading, in order of time",
    "temperature": "air temperature, °C",
    "side of the tool that is down": "gravity along the flange's z",
    "tool target and the side that is down": "T2",
    "side of the tool that is seen by the instrument": "line of sight along the tool's z",
    "tool target and the side that is seen by the instrument": "T2",
    "tool target": "T2",
    "region of the workspace": "from above; longest arrow",
    "time since the last move": "time since the reading before, s",
    "direction of the tool": "flange's z along the base's",
    "direction of view": "azimuth from the instrument, deg",
    "distance from the instrument": "distance from the instrument, mm",
    "overturning moment": "moment about the base's",
    "joint angles together": "highest third of θ",
}


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, PlotSample]:
    data = write_data(tmp_path_factory.mktemp("left"), effects=("outside:workspace_field",), n=150)
    dataset = read_dataset(data)
    return dataset, PlotSample.of(dataset, identify(dataset))


@pytest.mark.parametrize("where", PLACES)
def test_structure_is_drawn_where_it_lives(where: str, sample: tuple[Dataset, PlotSample]) -> None:
    picture = structure.picture_of(ResidualStructure(where, 1e-9, 0.5), 1, *sample)
    assert picture is not None
    assert picture.startswith("<svg")
    assert 'id="left1-' in picture
    assert PLACES[where] in picture
    assert (
        where in structure_caption(ResidualStructure(where, 1e-9, 0.5)) or where == "region of the workspace"
    )


def test_structure_on_an_axis_with_a_name_is_drawn_on_that_axis(sample: tuple[Dataset, PlotSample]) -> None:
    """Joint 1 of an arm on a track is its second axis.

    An effect of the track is no error of an angle.
    """
    dataset, drawn = sample
    named = {"axis_names": ("e1", "j1", "j2", "j3", "j4", "j5"), "unit_names": ("mm", *["deg"] * 5)}
    parts = tuple(replace(part, conditions=replace(part.conditions, **named)) for part in drawn.parts)
    on_track = replace(drawn, parts=parts)
    track = structure.picture_of(ResidualStructure(TOGETHER, 1e-9, 0.5, "joint e1"), 1, dataset, on_track)
    arm = structure.picture_of(ResidualStructure(TOGETHER, 1e-9, 0.5, "joint 1"), 1, dataset, on_track)
    assert track is not None
    assert arm is not None
    assert "mdeg" not in track
    assert "joint 1, mdeg" in arm


def test_a_place_without_a_name_we_know_is_listed_alone(sample: tuple[Dataset, PlotSample]) -> None:
    assert structure.picture_of(ResidualStructure("somewhere", 1e-9, 0.5), 1, *sample) is None


def test_every_driver_of_structure_has_quantities_to_be_drawn_over(
    sample: tuple[Dataset, PlotSample],
) -> None:
    dataset, drawn = sample
    for where in drivers(Space.of(drawn.fitted)):
        quantity = quantity_of(where, drawn.parts[0].conditions, dataset.header)
        if where == "tool target" or SEEN in where:  # a group, no quantity; by the fit, not its conditions
            continue
        assert quantity is not None, where
        assert quantity.values.shape == (len(drawn.parts[0].rows), len(quantity.labels))


def test_places_are_drawn_over_what_they_say(sample: tuple[Dataset, PlotSample]) -> None:
    dataset, drawn = sample
    conditions, header = drawn.parts[0].conditions, dataset.header
    moved = quantity_of("last move of joint 2", conditions, header)
    view = quantity_of("direction of view", conditions, header)
    assert moved is not None
    assert view is not None
    assert moved.values[:, 0] == pytest.approx(
        (conditions.joints[:, 1] - conditions.previous[:, 1]) / DEG, nan_ok=True
    )
    x, y, z = (conditions.point - np.array(header.noise.station_mm)).T
    azimuth, elevation = view.values.T * DEG
    assert np.tan(elevation) * np.hypot(x, y) == pytest.approx(z)
    assert np.cos(azimuth) * np.hypot(x, y) == pytest.approx(x)


def test_of_all_angles_those_are_drawn_that_tell_most() -> None:
    """An error that only the product of three angles shows: none of them alone, and no pair."""
    rng = np.random.default_rng(3)
    angles = rng.uniform(-1.0, 1.0, (600, 6))
    error = np.sign(angles[:, [0, 3, 4]]).prod(axis=1) + 0.3 * rng.normal(size=600)
    found = structure.most_telling(angles, error[:, None], np.ones(600))
    assert found is not None
    assert set(found) == {0, 3, 4}
    assert structure.most_telling(angles[:, :2], error[:, None], np.ones(600)) is None


def test_errors_of_poses_are_drawn_where_poses_were_visited_again(sample: tuple[Dataset, PlotSample]) -> None:
    dataset, once = sample
    left = ResidualStructure(EACH_POSE, 1e-9, 0.5)
    assert structure.picture_of(left, 1, dataset, once) is None
    part = once.parts[0]
    again = replace(part, conditions=replace(part.conditions, waypoint=np.arange(len(part.rows)) // 5))
    picture = structure.picture_of(left, 1, dataset, replace(once, parts=(again,)))
    assert picture is not None
    assert "every pose that was visited again" in picture


def test_readings_left_out_are_drawn_among_the_others(sample: tuple[Dataset, PlotSample]) -> None:
    dataset, whole = sample
    readings = whole.fitted.readings
    far = readings.conditions.joints[:, 1] > np.quantile(readings.conditions.joints[:, 1], 0.9)
    fitted = replace(whole.fitted, readings=readings.take(~far))
    left = ResidualStructure("joint 2 angle", 1e-9, 0.5, ACTS_ON)
    picture = structure.picture_of(left, 1, dataset, PlotSample.of(dataset, fitted))
    assert picture is not None
    crosses = [dots.count("<use") for dots in picture.split("</g>") if FITTED in dots]
    assert sum(crosses) == int(far.sum()) + len(whole.fitted.faulty_rows) + 1, "one stands in the legend"
    assert "left out" in picture
    assert "error, mm" in picture


def test_residual_vectors_are_measured_less_predicted(tmp_path: Path) -> None:
    dataset = read_dataset(write_data(tmp_path, n=60))
    final = identify(dataset)
    sample = PlotSample.of(dataset, final)
    left = sample.left(dataset)
    rows = final.readings.rows
    expected = dataset.points[rows] - final.predict(dataset.conditions.take(rows))
    np.testing.assert_allclose(left[: len(rows)], expected)
    assert len(left) == len(rows) + int(dataset.validation_rows.sum())


def test_dots_lie_where_they_are_and_are_round_in_a_report() -> None:
    drawn, (axes,) = drawing.figure(4.0, 2.0)
    drawing.dots(axes, np.array([0.0, 5.0, 10.0, 99.0]), np.array([0.0, 1.0, 2.0, 1.0]), size=2.0, alpha=0.5)
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(0.0, 2.0)
    svg = drawing.as_svg(drawn, "n", "dots")
    places = np.array(re.findall(r'<path d="M(\S+) (\S+)h.01"/>', svg), float)
    box = axes.get_position()
    width, height = 4.0 * 72.0, 2.0 * 72.0
    across = width * (box.x0 + box.width * np.array([0.0, 0.5, 1.0]))
    down = height * (1.0 - box.y0 - box.height * np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(places, np.column_stack([across, down]), atol=0.051)  # the fourth is outside
    css = (files("service") / "templates" / "report.css").read_text("utf-8")
    assert css.index("figure svg .dots * { stroke-linecap: round; }") > css.index("figure svg * { ")
    assert '<g class="dots"' in svg
