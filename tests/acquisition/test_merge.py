"""Several campaigns as one data set.

These would catch: ids that meet, a clock that restarts, and points left in the frame of nests measured again. They
would also catch rows that change their set, and campaigns of two cells merged.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import RecordError
from acquisition.record.export import DataTable
from acquisition.record.merge import CampaignPart, merge
from calib.data.header import MeasurementOccasion
from calib.data.read import read_dataset
from tests.service.campaigns import edit_text, read_rows, write_data

WORLD = WorldFrame(np.eye(3), np.array([100.0, 0.0, 0.0]))
AGAIN = WorldFrame(Rotation.from_rotvec([0.0, 1e-4, 0.0]).as_matrix(), np.array([100.1, -0.05, 0.02]))


@pytest.fixture
def campaigns(tmp_path: Path) -> tuple[Path, Path]:
    return write_data(tmp_path / "first", n=20), write_data(tmp_path / "later", seed=5, n=10)


def _table(data: Path) -> DataTable:
    rows = read_rows(data)
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    return DataTable(data.stem, columns, tomllib.loads(data.with_suffix(".toml").read_text("utf-8")))


def test_ids_clock_and_sets(campaigns: tuple[Path, Path], tmp_path: Path) -> None:
    first, later = campaigns
    out = merge(
        _table(first),
        WORLD,
        [CampaignPart(_table(later), 5000.0, None), CampaignPart(_table(later), 9000.0, None)],
    ).write(tmp_path / "all.csv")
    rows, one, two = read_rows(out), read_rows(first), read_rows(later)
    assert rows[: len(one)] == one
    assert [row["reading_id"] for row in rows[len(one) :]] == [
        f"{k}-{row['reading_id']}" for k in (2, 3) for row in two
    ]
    for row, was in zip(rows[len(one) :], two, strict=False):
        assert float(row["t_s"]) == pytest.approx(float(was["t_s"]) + 5000.0)
        assert {k: v for k, v in row.items() if k not in ("reading_id", "t_s")} == {
            k: v for k, v in was.items() if k not in ("reading_id", "t_s")
        }
    assert len(read_dataset(out)) == len(rows)
    assert read_dataset(out).validation_rows.sum() == sum(row["set"] == "validation" for row in one + 2 * two)


def test_points_come_into_the_first_frame(campaigns: tuple[Path, Path], tmp_path: Path) -> None:
    first, later = campaigns
    out = merge(_table(first), WORLD, [CampaignPart(_table(later), 0.0, AGAIN)]).write(tmp_path / "all.csv")
    exported, joined = read_dataset(later).points, read_dataset(out).points[-len(read_rows(later)) :]
    seen = AGAIN.to_tracker(exported)
    np.testing.assert_allclose(joined, seen + WORLD.origin, atol=2e-6)
    assert np.max(np.abs(joined - exported)) > 0.05


def test_another_station_is_no_other_cell_but_another_tool_is(
    campaigns: tuple[Path, Path], tmp_path: Path
) -> None:
    first, later = campaigns
    header = later.with_suffix(".toml")
    edit_text(header, "2400.0", "2400.02")
    merge(_table(first), WORLD, [CampaignPart(_table(later), 0.0, AGAIN)])
    edit_text(header, "93.675", "93.775")
    with pytest.raises(RecordError, match="not measured in the cell"):
        merge(_table(first), WORLD, [CampaignPart(_table(later), 0.0, AGAIN)])


@pytest.mark.parametrize(
    ("said", "whole"),
    [
        (("", "robot: at once", ""), "robot: at once"),
        (("robot: at once", "", ""), "robot: at once"),
        (("robot: at once", "instrument: no sums", "robot: at once"), "robot: at once; instrument: no sums"),
        (("", "", ""), ""),
    ],
)
def test_what_a_wire_could_not_see_of_any_part_is_said_of_the_whole(
    campaigns: tuple[Path, Path], tmp_path: Path, said: tuple[str, str, str], whole: str
) -> None:
    first, later = campaigns
    again = write_data(tmp_path / "again", seed=6, n=10)
    for data, text in zip((first, later, again), said, strict=True):
        header = data.with_suffix(".toml")
        header.write_text((f'unprotected = "{text}"\n' if text else "") + header.read_text("utf-8"), "utf-8")
    out = merge(
        _table(first), WORLD, [CampaignPart(_table(later), 0.0, None), CampaignPart(_table(again), 0.0, None)]
    ).write(tmp_path / "all.csv")
    assert read_dataset(out).header.unprotected == whole


def test_the_whole_was_measured_from_the_first_reading_to_the_last_by_everybody(
    campaigns: tuple[Path, Path], tmp_path: Path
) -> None:
    again = write_data(tmp_path / "again", seed=6, n=10)
    said = {
        campaigns[0]: ("2026-03-02 09:15 UTC", "2026-03-02 10:00 UTC", '["anna"]'),
        again: ("2026-03-01 08:00 UTC", "2026-03-01 09:00 UTC", '["bert", "anna"]'),
    }
    for data, (began, ended, operators) in said.items():
        table = f'\n[measured]\nbegan = "{began}"\nended = "{ended}"\noperators = {operators}\n'
        header = data.with_suffix(".toml")
        header.write_text(header.read_text("utf-8") + table, "utf-8")
    # the first of the parts says nothing
    parts = [CampaignPart(_table(campaigns[1]), 0.0, None), CampaignPart(_table(again), 0.0, None)]
    occasion = merge(_table(campaigns[0]), WORLD, parts).dataset().header.occasion
    assert occasion == MeasurementOccasion(
        "2026-03-01 08:00 UTC", "2026-03-02 10:00 UTC", ("anna", "bert"), campaigns=3
    )
