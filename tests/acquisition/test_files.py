"""Cell and campaign files: accepted values, and refusals by file and key."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from acquisition.campaign.campaign import (
    CampaignTable,
    campaign_from,
    campaign_of_record,
    read_campaign,
    read_poses,
)
from acquisition.cell.cell import cell_of_record, read_cell, with_places
from acquisition.cell.obstacles import Box
from drivers.errors import ConfigError
from tests.acquisition.fakes import a_campaign, a_cell
from tests.calib.machines import machine

EXAMPLE = Path(__file__).parents[2] / "examples" / "irb120_faro"


def test_example_is_read() -> None:
    cell, campaign = read_cell(EXAMPLE / "cell.toml"), read_campaign(EXAMPLE / "campaign.toml")
    assert cell.robot.model.name == "abb-irb120"
    assert cell.robot.limits_deg[1] == (0.0, 110.0)
    assert cell.loads == cell.robot.model.loads  # the example's tool is the thesis's
    assert [block.set for block in campaign.blocks] == ["calibration", "validation"]
    assert campaign.blocks[0].approach.sides == "both"


def test_what_the_record_keeps_means_the_same(tmp_path: Path) -> None:
    cell, campaign = read_cell(EXAMPLE / "cell.toml"), read_campaign(EXAMPLE / "campaign.toml")
    assert cell_of_record(cell.source, str(tmp_path / "record")) == cell
    assert campaign_of_record(campaign.source, "record") == campaign
    assert campaign_of_record(a_campaign().source, "record").blocks == a_campaign().blocks


def test_a_cell_goes_to_another_process_and_its_copies_know_their_own_obstacles() -> None:
    cell = a_cell()
    assert pickle.loads(pickle.dumps(cell)) == cell
    obstacles = cell.clearance.obstacles
    assert len(
        with_places(cell, {}, [Box(name="b", low_mm=(2e3, 0, 0), high_mm=(3e3, 1, 1))]).clearance.obstacles
    ) == (len(obstacles) + 1)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"format": "truepose-cell/9"}, "format"),
        ({"robot__model": "nonesuch"}, "robot.model"),
        ({"robot__speed_mm_s": 900.0}, "robot.speed_mm_s"),
        ({"robot__speed_deg_s": "fast"}, "robot.speed_deg_s"),
        ({"robot__limits_deg": [[-90, 90]]}, "robot.limits_deg"),
        ({"robot__limits_deg": [[-170, 90]] + [[-10, 10]] * 5}, "robot.limits_deg"),
        ({"robot__limit_deg": []}, "robot.limit_deg"),
        ({"robot__keep_out": [[[0, 0, 0], [1, 1, -1]]]}, "robot.keep_out"),
        ({"robot__keep_out": 1.5}, "robot.keep_out"),
        ({"world__nests": {"N1": [0, 0, 0], "N2": [1e200, 0, 0], "N3": [0, 600, 0]}}, "world.nests.N2"),
        ({"robot__table_z_mm": float("nan")}, "robot.table_z_mm"),
        ({"instrument__station_mm": [1, 2]}, "instrument.station_mm"),
        ({"instrument__one_smr": 1}, "instrument.one_smr"),
        ({"world__nests": {"N1": [0, 0, 0], "N2": [600, 0, 0]}}, "world.nests"),
        ({"world__nests": {"N1": [0, 0, 0], "N2": [600, 0, 0], "N3": [300, 0, 0]}}, "world.nests"),
        ({"tool__targets": {}}, "tool.targets"),
        ({"tool__targets": {"T 1": [0, 0, 1]}}, "tool.targets"),
        ({"tool__targets": {"N1": [0, 0, 1]}}, "tool.targets"),
        ({"tool__cog_mm": None}, "tool.mass_kg"),
        ({"tool__normals": {"T9": [0, 0, 1]}}, "tool.normals"),
        ({"tool__normals": {"T1": [0, 0, 0]}}, "tool.normals"),
        ({"simulation": {"time_scale": 0}}, "simulation.time_scale"),
        ({"simulation": {"misplaced_mm": {"N9": [0, 0, 1]}}}, "simulation.misplaced_mm"),
        ({"simulation": {"misplaced_mm": {"N1": 0.3}}}, "simulation.misplaced_mm.N1"),
        ({"world__u_m": 0.3}, "world.u_m"),
        ({"world__u_mm": -0.3}, "world.u_mm"),
        ({"world__u_mm": "small"}, "world.u_mm"),
        ({"world__u_mm": 1e-30}, "world.u_mm"),
        ({"world__nests_u_mm": {"N9": 0.3}}, "world.nests_u_mm.N9"),
        ({"world__nests_u_mm": 0.3}, "world.nests_u_mm"),
        ({"tool__target_u_mm": {}}, "tool.target_u_mm"),
        ({"tool__targets_u_mm": {"T1": [0.1]}}, "tool.targets_u_mm.T1"),
        ({"surprise": 1}, "surprise"),
        ({"robot__file": 5}, "robot.file"),
        ({"robot__model": "a\u202eb"}, "robot.model"),
        ({"robot__speed_mm_s": 10**400}, "robot.speed_mm_s"),
        ({"robot__keep_out": [[[0, 0]]]}, "robot.keep_out"),
        ({"instrument__length_mm": 0.1}, "instrument.length_mm"),
        ({"instrument__driver": "nonesuch"}, "instrument.driver"),
        ({"instrument__driver": "qc20w"}, "instrument.station_mm"),
        ({"world__nests": {f"N{i}": "x" for i in range(5000)}}, "world.nests.N0"),
        ({"fixture": [{}] * 5000}, "fixture[0].name"),
        ({"fixture": [{"name": "a", "low_mm": [0, 0, 0]}]}, "fixture[0].high_mm"),
        ({"simulation": {"sed": 3}}, "simulation.sed"),
    ],
)
def test_cell_refused(change: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        a_cell(**change)
    assert f"key '{key}'" in str(caught.value)
    assert "cell.toml" in str(caught.value)
    assert len(str(caught.value)) < 1000
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(("name", "words"), [("track", "slide (e1)"), ("seven", "7 joints")])
def test_a_robot_that_its_driver_does_not_move_is_refused(name: str, words: str, tmp_path: Path) -> None:
    """Before anything connects: mm must never be sent where degrees are meant."""
    machine(name, tmp_path)
    with pytest.raises(ConfigError) as caught:
        a_cell(robot__model=str(tmp_path / f"{name}.toml"))
    assert "key 'robot.model'" in str(caught.value)
    assert words in str(caught.value)


BLOCK: dict[str, Any] = {"set": "calibration", "count": 2}


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"format": "x"}, "format"),
        ({"approach": {"offset_deg": 0.0}}, "approach.offset_deg"),
        ({"approach": {"longest_deg": 4.0}}, "approach.longest_deg"),
        ({"approach": {"offset_deg": 6.0, "longest_deg": 31.0}}, "approach.longest_deg"),
        ({"approach": {"sides": "left"}}, "approach.sides"),
        ({"settle_s": -1}, "settle_s"),
        ({"samples": 0}, "samples"),
        ({"samples": True}, "samples"),
        ({"retries": 1.5}, "retries"),
        ({"name": 5}, "name"),
        ({"name": ["a"]}, "name"),
        ({"name": "a\u202eb"}, "name"),
        ({"settle_s": 10**400}, "settle_s"),
        ({"robot": {"serial": None}}, "robot.serial"),
        ({"block": [BLOCK | {"kind": None}]}, "block[0].kind"),
        ({"order": "any"}, "order"),
        ({"block": []}, "block"),
        ({"block": [BLOCK | {"kind": "dance"}]}, "block[0].kind"),
        ({"block": [BLOCK | {"joint": 4}]}, "block[0].joint"),
        ({"block": [{"select": "observability"}]}, "block[0].count"),
        ({"block": [BLOCK | {"select": "grid"}]}, "block[0].select"),
        ({"block": [BLOCK | {"set": "test"}]}, "block[0].set"),
        ({"block": [BLOCK, BLOCK | {"count": 0}]}, "block[1].count"),
        ({"block": [BLOCK | {"targets": []}]}, "block[0].targets"),
        ({"block": [{"select": "list", "joints_deg": [[0, 1], [0]]}]}, "block[0].joints_deg"),
        ({"block": [BLOCK | {"targets": [["T1"], ["T2"]]}]}, "block[0].targets"),
        ({"block": [BLOCK | {"targets": ["T1", "T1"]}]}, "block[0].targets"),
        ({"block": [BLOCK | {"targets": [1]}]}, "block[0].targets"),
        ({"block": [BLOCK | {"targets": "T1"}]}, "block[0].targets"),
        ({"block": [{"select": "list"}]}, "block[0].joints_deg"),
        (
            {"block": [{"select": "list", "joints_deg": [[0] * 6], "approach_sides": [[True] * 6]}]},
            "block[0].approach_sides",
        ),
    ],
)
def test_campaign_refused(change: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        a_campaign(**change)
    assert f"key '{key}'" in str(caught.value)
    assert caught.value.exit_code == 2


_MANY = 5000


@pytest.mark.parametrize(
    "wrong",
    [
        {"block": [{"kind": "poses", "select": "list", "joints_deg": [["x"] * 6] * _MANY}]},
        {"block": [{"kind": "poses", "select": "list", "joints_deg": ["x"] * _MANY}]},
        {"block": [{}] * _MANY},
        {"block": [{"kind": "poses", "surprise": 1}] * _MANY},
        {"block": [{"kind": "poses", "count": 3, "targets": [0] * _MANY}]},
        {"block": [{"kind": "poses", "approach": {f"key{i}": "x" for i in range(_MANY)}}]},
        {"block": [{"kind": "legs", "joints_deg": [[0.0] * 6], "legs": [[["x"]]] * _MANY}]},
        {f"key{i}": 0 for i in range(_MANY)},
        {f"key{i}": None for i in range(_MANY)},
        {"robot": {f"key{i}": "x" for i in range(_MANY)}},
    ],
)
def test_a_campaign_with_thousands_of_errors_describes_few(wrong: dict[str, Any]) -> None:
    """A description of all errors holds the interpreter for a second.

    The stop of a robot would wait as long.
    """
    table = {"format": "truepose-campaign/1", **wrong}
    with pytest.raises(ValidationError) as every:
        CampaignTable.model_validate(table)
    assert every.value.error_count() < 50
    with pytest.raises(ConfigError) as caught:
        campaign_from(table, "campaign.toml")
    assert len(str(caught.value)) < 1000


def test_missing_and_broken_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        read_cell(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("= 3")
    with pytest.raises(ConfigError, match="not valid TOML"):
        read_campaign(tmp_path / "bad.toml")


def test_files_saved_by_notepad_are_read(tmp_path: Path) -> None:
    text = (EXAMPLE / "cell.toml").read_text("utf-8")
    (tmp_path / "cell.toml").write_text(text, "utf-8-sig")
    assert read_cell(tmp_path / "cell.toml") == read_cell(EXAMPLE / "cell.toml")


def test_poses_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("name,j1_deg,j2_deg\na,1.0,2\n\nb,-3,4.5\n")
    assert read_poses(path) == ((1.0, 2.0), (-3.0, 4.5))
    path.write_text("j1_deg,j2_deg\n1,x\n")
    with pytest.raises(ConfigError, match="line 2"):
        read_poses(path)
    path.write_text("q1,q2\n1,2\n")
    with pytest.raises(ConfigError, match="no columns j1_deg"):
        read_poses(path)


def test_prompts_only_confirm_themselves_where_the_cell_file_says_so() -> None:
    assert not a_cell().rehearsed
    assert a_cell(simulation={"operator": "confirms"}).rehearsed
    with pytest.raises(ConfigError, match=r"simulation\.operator': is 'robot'. Use 'person' or 'confirms'"):
        a_cell(simulation={"operator": "robot"})
