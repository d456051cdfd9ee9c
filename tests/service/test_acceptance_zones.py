"""Acceptance by zone: a verdict for every box of the base frame.

It is in HTML, JSON, certificate and exit code. These would catch: a zone judged by readings outside it, an empty zone
that passes, and a zone that is not met but does not count. They would also catch boxes taken in the world frame, and a
misspelled limit that passes for none.
"""

from __future__ import annotations

import html
import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import Dataset, read_dataset
from calib.fit import IdentificationFit, errors_on, identify
from calib.validation import targets_in_base
from service.cli import main
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceShown, Zone, decide, read_zones
from tests.service.campaigns import write_data
from tests.service.certificates import MEASURED

LOWEST, HIGHEST = (-5e3, -5e3, -5e3), (5e3, 5e3, 5e3)
NOWHERE = Zone("far <b>away</b>", (9e3, 9e3, 9e3), (9.1e3, 9.1e3, 9.1e3), 9.0, None)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("zones"), effects=(), n=60)


def test_the_faces_of_a_zone_belong_to_it_and_nothing_beyond_does() -> None:
    low, high = np.array([200.0, -400.0, 0.0]), np.array([500.0, -100.0, 300.0])
    zone = Zone("table", (200.0, -400.0, 0.0), (500.0, -100.0, 300.0), 0.1, None)
    middle = 0.5 * (low + high)
    for axis in range(3):
        for face, out in ((low, -1e-9), (high, 1e-9)):
            on = middle.copy()
            on[axis] = face[axis]
            beyond = on.copy()
            beyond[axis] += out
            assert zone.holds(np.array([on, beyond])).tolist() == [True, False]
    assert zone.holds(np.array([low, high])).all()


@pytest.fixture(scope="module")
def found(data: Path) -> tuple[Dataset, IdentificationFit]:
    dataset = read_dataset(data)
    return dataset, identify(dataset)


def split(dataset: Dataset, fit: IdentificationFit, limit: float) -> tuple[Zone, Zone]:
    """Two halves of the workspace, divided at the median of x in the base frame."""
    x = targets_in_base(dataset, fit.model, fit.estimate)[dataset.validation_rows, 0]
    middle = float(np.median(x))
    low = Zone("low", LOWEST, (middle, 5e3, 5e3), limit, None)
    return low, Zone("high", (middle + 1e-6, -5e3, -5e3), HIGHEST, limit, None)


def test_every_zone_is_judged_by_its_own_readings(found: tuple[Dataset, IdentificationFit]) -> None:
    dataset, fit = found
    zones = split(dataset, fit, 1.0)
    held = decide(
        AcceptanceLimits(None, None, zones),
        dataset,
        dataset.validation_rows,
        fit.model,
        fit.estimate,
        "model",
    )
    errors = errors_on(dataset, dataset.validation_rows, fit.model, fit.estimate)
    x = targets_in_base(dataset, fit.model, fit.estimate)[dataset.validation_rows, 0]
    for criterion, mine in zip(held.criteria, (x <= np.median(x), x > np.median(x)), strict=True):
        assert criterion.figure == pytest.approx(np.sqrt(np.mean(errors[mine] ** 2)))
    assert held.verdict == "accepted"


def test_one_zone_that_is_not_met_rejects_and_an_empty_one_decides_nothing(
    found: tuple[Dataset, IdentificationFit],
) -> None:
    dataset, fit = found
    judged = (dataset, dataset.validation_rows, fit.model, fit.estimate, "model")
    low, high = split(dataset, fit, 1.0)
    assert decide(AcceptanceLimits(1.0, None, (low, replace(high, rms=1e-4))), *judged).verdict == "rejected"
    held = decide(AcceptanceLimits(1.0, None, (low, high, NOWHERE)), *judged)
    assert held.verdict == "not_decided"
    assert AcceptanceShown.model_validate(held).criteria[-1].figure_mm is None
    assert AcceptanceLimits.kept(
        json.loads(json.dumps(asdict(AcceptanceLimits(1.0, None, (NOWHERE,)))))
    ) == AcceptanceLimits(1.0, None, (NOWHERE,))


def test_boxes_count_from_the_base_wherever_the_robot_stands(
    found: tuple[Dataset, IdentificationFit],
) -> None:
    dataset, fit = found
    here = targets_in_base(dataset, fit.model, fit.estimate)
    elsewhere = fit.estimate.copy()
    elsewhere[fit.model.of_base] += 0.3
    assert np.array_equal(here, targets_in_base(dataset, fit.model, elsewhere))
    reach = np.linalg.norm(here, axis=1)
    assert reach.max() < 1200.0  # of an IRB 120 with its tool, mm; the world's origin is far away


def test_the_verdict_of_every_zone_is_everywhere(data: Path, tmp_path: Path) -> None:
    header = data.with_suffix(".toml").read_text("utf-8")
    (tmp_path / "d.toml").write_text(header + MEASURED, "utf-8")
    (tmp_path / "d.csv").write_bytes(data.read_bytes())
    (tmp_path / "zones.toml").write_text(
        '[[zone]]\nname = "all <i>of</i> it"\nlow_mm = [-5000, -5000, -5000]\nhigh_mm = [5000, 5000, 5000]\n'
        'accept_rms_mm = 5.0\naccept_max_mm = 9.0\n[[zone]]\nname = "door"\nlow_mm = [9000, 0, 0]\n'
        "high_mm = [9001, 1, 1]\naccept_max_mm = 9.0\n",
        "utf-8",
    )
    names = {"--json": "r.json", "--report": "r.html", "--dcc": "r.xml"}
    outputs = [part for option, name in names.items() for part in (option, str(tmp_path / name))]
    zones = ["--accept-zones", str(tmp_path / "zones.toml")]
    assert main(["identify", str(tmp_path / "d.csv"), *outputs, *zones]) == 3
    kept = json.loads((tmp_path / "r.json").read_text("utf-8"))["acceptance"]
    assert [(c["zone"], c["quantity"], c["verdict"]) for c in kept["criteria"]] == [
        ("all <i>of</i> it", "rms", "accepted"),
        ("all <i>of</i> it", "max", "accepted"),
        ("door", "max", "not_decided"),
    ]
    page = (tmp_path / "r.html").read_text("utf-8")
    assert html.escape("Largest error in zone all <i>of</i> it") in page
    assert "<i>of</i>" not in page
    assert "x 9000 to 9001, y 0 to 1, z 0 to 1 mm in the base frame" in page
    assert "in zone door: none" in (tmp_path / "r.xml").read_text("utf-8")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "names no zone"),
        ('[[zone]]\nname = "a"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 1, 1]\n', "accept_max_mm"),
        ('[[zone]]\nname = "a"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 0, 1]\naccept_rms_mm = 1\n', "high_mm"),
        ('[[zone]]\nname = "a"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 1, 1]\naccept_rms = 1\n', "accept_rms"),
        ('[[zone]]\nname = " "\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 1, 1]\naccept_rms_mm = 1\n', "name"),
        (
            2 * '[[zone]]\nname = "a"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 1, 1]\naccept_rms_mm = 1\n',
            "two zones",
        ),
    ],
)
def test_zones_that_mean_nothing_are_refused(
    text: str, told: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "zones.toml").write_text(text, "utf-8")
    assert main(["identify", str(data), "--accept-zones", str(tmp_path / "zones.toml")]) == 2
    assert told in capsys.readouterr().err


def test_zones_are_read_as_written(tmp_path: Path) -> None:
    (tmp_path / "zones.toml").write_text(
        '[[zone]]\nname = "table"\nlow_mm = [1, 2, 3]\nhigh_mm = [4, 5, 6]\naccept_max_mm = 0.25\n', "utf-8"
    )
    assert read_zones(tmp_path / "zones.toml") == (
        Zone("table", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), None, 0.25),
    )
