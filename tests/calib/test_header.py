"""Test the influence of the header on the model.

These would catch: a level that frees the wrong parameter, a held parameter that moves, a prior that affects another
parameter, and misspelt keys that are skipped without a message.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calib import DataError, Dataset, identify, read_dataset
from calib.data import header_of
from mocks.campaign import make_campaign, write_campaign
from tests.calib.cells import NOISE, Cell
from tests.calib.test_kinds_of_reading import miss


class TestHeader:
    def data(self, folder: Path, **more: Any) -> Dataset:
        cell = Cell()
        cell.measure("p", 60, noise=NOISE)
        return cell.dataset(folder, **more)

    @pytest.mark.parametrize(
        ("level", "labels", "count"),
        [
            (1, ["base", "joint_offsets", "encoder_scale"], 6 + 5 + 6),
            (2, ["base", "geometry", "parallel_twist"], 6 + 20 + 1),
            (3, ["base", "geometry", "parallel_twist", "compliance"], 6 + 20 + 1 + 5),
        ],
    )
    def test_levels(self, level: int, labels: list[str], count: int, tmp_path: Path) -> None:
        result = identify(self.data(tmp_path, model={"level": level}))
        assert [e.label for e in result.model.effects] == labels
        assert len(result.estimate) == count

    def test_what_is_held_stays_nominal(self, tmp_path: Path) -> None:
        result = identify(self.data(tmp_path, world="nominal", model={"hold": ["d3", "c6", "base.z"]}))
        assert not {"d3", "c6", "base.z"} & set(result.model.index)
        assert result.dropped == ()
        assert len(result.estimate) == 32 - 3

    def test_priors_pull_by_name_kind_and_group(self, tmp_path: Path) -> None:
        free = identify(self.data(tmp_path / "1"))
        priors = {"alpha4": 1e-9, "a": 1e-9, "compliance": 1e-9}
        tight = identify(self.data(tmp_path / "2", model={"priors": priors}))
        for name, position in tight.model.index.items():
            named = name == "alpha4" or name[0] in "c" or (name[0] == "a" and name[1:].isdigit())
            assert (abs(tight.estimate[position]) < 1e-10) == (named or name == "d3"), name
        assert abs(free.estimate[free.model.index["alpha4"]]) > 1e-5
        assert tight.noise_scale > 2.0 * free.noise_scale

    @pytest.mark.parametrize(
        ("model", "words"),
        [
            ({"hold": ["d9"]}, "d9.*does not have.*alpha2"),
            ({"priors": {"gamma": 1.0}}, "gamma.*does not have.*alpha2"),
        ],
    )
    def test_what_the_model_does_not_have(self, model: dict[str, Any], words: str, tmp_path: Path) -> None:
        with pytest.raises(DataError, match=f"(?s){words}"):
            identify(self.data(tmp_path, model=model))

    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ({"gravity": [0, 0, -9.81]}, "'gravity'.*mean 'gravity_base'"),
            (
                {"noise": {"kind": "isotropic", "sigma_mm": 0.03, "range_pm": 2.0}},
                "'noise.range_pm'.*'range_ppm'",
            ),
            ({"model": {"held": ["d3"]}}, "'model.held'.*'hold'"),
            ({"series": {"main": {"tool_target": {}}}}, "'series.main.tool_target'.*'tool_targets'"),
        ],
    )
    def test_misspelt_keys_are_refused(self, more: dict[str, Any], words: str, tmp_path: Path) -> None:
        with pytest.raises(DataError, match=f"(?s){words}"):
            self.data(tmp_path, **more)

    def test_a_key_that_is_like_no_other_is_noted(self, tmp_path: Path) -> None:
        result = identify(self.data(tmp_path, weather="rain"))
        assert any("'weather' is not known" in w for w in result.warnings)

    @pytest.mark.parametrize(
        "header",
        [
            {"model": {"hold": ["base.z"]}},
            {"model": {"priors": {"base": 5.0}}},
            {"model": {"priors": {"B2.x": 0.1}}, "base_targets": {"B2": "free"}},
            {"model": {"priors": {"base_targets": 0.1}}, "base_targets": "free", "world": "nominal"},
        ],
    )
    def test_nothing_is_known_of_what_is_free(self, header: dict[str, Any], tmp_path: Path) -> None:
        """A free parameter without a nominal value cannot be held.

        Its start is a guess from the readings; held there, it would bias everything else without a message.
        """
        cell = Cell()
        cell.base_targets = {"B2": cell.base_targets["B2"]}
        cell.measure("pl", 60)
        with pytest.raises(DataError, match=r"leaves free.*no nominal value"):
            identify(cell.dataset(tmp_path, **header))

    @pytest.mark.parametrize("world", ["free", "nominal"])
    def test_a_tool_that_is_known_in_part(self, world: str, tmp_path: Path) -> None:
        """A held or weighted tool keeps the header's position and takes no start from readings."""
        cell = Cell()
        cell.targets["T2"] = cell.targets["T2"] + [4.0, -3.0, 0.0]
        cell.measure("p", 80, ["T2"])
        model = {"fit": ["base", "geometry", "parallel_twist", "compliance", "tool"], "hold": ["T2.z"]}
        data = cell.dataset(tmp_path / world, world=world, model=model)
        result = identify(data)
        assert result.model.targets["main"]["T2"] == (75.0, 93.675, 215.0)
        assert "d6" not in [drop.name for drop in result.dropped], (
            "with the height of the tool known, link 6 is seen"
        )
        assert miss(cell, data, result).max() < 1e-6
        weighed = {**model, "hold": [], "priors": {"T2.z": 0.01}}
        result = identify(cell.dataset(tmp_path / "weighed", world=world, model=weighed))
        assert "d6" not in [drop.name for drop in result.dropped]
        position = result.model.index["T2.z"]
        assert result.standard_errors[position] == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("given", "typed"), [("approach2", "aproach2"), ("status", "staus"), ("tool_target", "Tool_Target")]
)
def test_a_misspelt_column_is_refused(given: str, typed: str, tmp_path: Path) -> None:
    """Otherwise a rejected row would enter the fit, or a side of approach would be guessed."""
    path = _written(tmp_path, given, typed)
    with pytest.raises(DataError, match=f"line 1: column '{typed}' is not known. Did you mean '{given}'"):
        read_dataset(path)


@pytest.mark.parametrize(
    "typed", ["prev7_deg", "t_base_c", "j3_read_deg", "remark", "visits_planned", "d_length_mm"]
)
def test_other_columns_are_kept(typed: str, tmp_path: Path) -> None:
    path = _written(tmp_path, "status", f"status,{typed}")
    assert read_dataset(path)


def _written(folder: Path, given: str, typed: str) -> Path:
    """Write a campaign with the column `given` headed `typed`.

    If `typed` names further columns, those are empty.
    """
    path = Path(write_campaign(make_campaign(seed=3, n=60, n_validation=0, effects=[]), folder)["csv"])
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    more = typed.count(",") * ","
    path.write_text(
        "\n".join([head.replace(given, typed), *(row + more for row in rows)]) + "\n", encoding="utf-8"
    )
    return path


@pytest.mark.parametrize(("given", "typed"), [("sigma_mm", "sigma"), ("kind", "kid"), ("robot", "robt")])
def test_a_misspelt_key_that_must_be_there_is_named(given: str, typed: str, tmp_path: Path) -> None:
    """The misspelt key is named instead of being reported as missing."""
    header = {"format": "truepose-dataset/1", "robot": "ur5", "noise": {"kind": "isotropic", "sigma_mm": 0.1}}
    noise = {typed if key == given else key: value for key, value in header["noise"].items()}
    table = {typed if key == given else key: value for key, value in (header | {"noise": noise}).items()}
    with pytest.raises(DataError, match=f"{typed}': is not known. Did you mean '{given}'"):
        header_of(table, tmp_path / "data.toml", "")
