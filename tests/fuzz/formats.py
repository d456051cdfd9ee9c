"""Every file format of users and other programs: good examples, mutations and readers."""

from __future__ import annotations

import io
import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tomli_w
from openpyxl import Workbook

from acquisition import read_campaign, read_cell
from acquisition.campaign.blocks.poses import read_poses
from calib.arm.robot import BUILT_IN, load_robot
from calib.array import Array
from calib.convert import IMPORTERS
from calib.data.dataset import Dataset
from calib.data.read import read_dataset
from calib.errors import DataError
from calib.fit.identify import identify
from calib.foreign import converted, propose, read_map, text_of
from calib.model.model import StatedConditions
from calib.motion.read import read_joints, read_points
from calib.regression.mls_svr import Linear, fit
from calib.regression.regression import Regression, RegressionRequest, evaluate, turns
from calib.robot_file import import_dh, import_urdf
from calib.saved.model_file import CalibratedModel, load_model, save_model
from calib.watch import read_history
from drivers.errors import ConfigError
from drivers.manual.meter import InvalidEntry
from drivers.manual.meter import rows_of as typed_rows
from mocks.campaign import make_campaign
from service.programs import KnownFrames, compensate
from service.programs.read import read_program
from tests.calib.campaigns import write_files
from tests.calib.test_dh_import import SAME
from tests.calib.test_urdf_import import six, urdf
from tests.fuzz.mutations import (
    Mutation,
    spoil_bytes,
    spoil_cells,
    spoil_history,
    spoil_json,
    spoil_lines,
    spoil_packed,
    spoil_toml,
)
from tests.service.maker_programs import PROGRAMS, a_model
from tests.service.robot_programs import LS, RAPID, SCRIPT, model_of

EXAMPLES = Path(__file__).parents[2] / "examples"
URDF, DH_TABLE = urdf(*six()), SAME["multiples of pi, metres"]
ANSWERS = {"robot": "abb-irb120"}
ANYTHING: tuple[Mutation, ...] = (spoil_bytes, spoil_lines)


@dataclass(frozen=True)
class Format:
    """File format under test.

    `good` is a correct file of this name. `read` takes its path and may raise the project's errors only.
    """

    name: str
    good: bytes
    spoil: Sequence[Mutation]
    read: Callable[[Path], object]


def formats(folder: Path) -> dict[str, Format]:
    """Build all formats by the name of their file.

    The good files that they need are written to `folder`.
    """
    campaign = make_campaign(seed=3, n=40, n_validation=6, effects=[])
    data = write_files(folder, campaign.rows, campaign.header)
    dataset = read_dataset(data)
    save_model(folder / "model.json", identify(dataset), regression=_regression(dataset))
    table, cells = (*ANYTHING, spoil_toml), (*ANYTHING, spoil_cells)
    robot = (BUILT_IN / "abb-irb120.toml").read_bytes()
    header = tomllib.loads(data.with_suffix(".toml").read_text("utf-8"))
    lengths = header | {"base_targets": {"B1": [300.0, 0.0, 0.0]}, "series": {"main": {"tool_targets": {}}}}
    lengths |= {"loads": [{"link": 6, "mass_kg": 2.0, "cog_mm": [1.0, 2.0, 3.0]}]}
    example = EXAMPLES / "irb120_faro"
    own = _own_table(np.degrees(dataset.conditions.joints), dataset.points)
    (folder / "own.csv").write_text(own, encoding="utf-8")
    kept = text_of(propose([folder / "own.csv"], ANSWERS).made)
    (folder / "map.toml").write_text(kept, encoding="utf-8")
    irb, fanuc, ur = (model_of(name) for name in ("abb-irb120", "fanuc-lrmate200ic", "ur5"))
    found = [
        Format("data.csv", data.read_bytes(), cells, read_dataset),
        Format(
            "data.toml",
            tomli_w.dumps(lengths).encode(),
            table,
            lambda path: read_dataset(path.with_suffix(".csv")),
        ),
        Format("robot.toml", robot, table, lambda path: load_robot(path.name, path.parent)),
        Format("arm.urdf", URDF.encode(), ANYTHING, import_urdf),
        Format("table.csv", DH_TABLE.encode(), cells, lambda path: import_dh(path, "dh")),
        Format("cell.toml", (example / "cell.toml").read_bytes(), table, read_cell),
        Format("campaign.toml", (example / "campaign.toml").read_bytes(), table, read_campaign),
        Format("poses.csv", b"j1_deg,j2_deg,j3_deg\n1,2,3\n4,5,6\n", cells, read_poses),
        Format("model.json", (folder / "model.json").read_bytes(), (*ANYTHING, spoil_json), load_model),
        Format("targets.csv", _targets(), cells, partial(_corrected, irb)),
        Format("program.mod", RAPID.encode(), ANYTHING, partial(_corrected, irb)),
        Format("program.ls", LS.encode(), ANYTHING, partial(_corrected, fanuc)),
        Format("program.script", SCRIPT.encode(), ANYTHING, partial(_corrected, ur)),
        *(
            Format(
                f"maker{Path(name).suffix}",
                text.encode("latin-1"),
                ANYTHING,
                partial(_corrected, a_model(maker)),
            )
            for name, (maker, text) in PROGRAMS.items()
        ),
        Format("own.csv", own.encode(), ANYTHING, partial(_own, folder)),
        Format("own.xlsx", _workbook(own), (*ANYTHING, spoil_packed), partial(_own, folder)),
        Format(
            "map.toml",
            kept.encode(),
            table,
            lambda path: converted(read_map(path), [folder / "own.csv"], path, folder),
        ),
        Format("history.jsonl", _history(), (*ANYTHING, spoil_history), read_history),
        Format("typed.txt", b"X 12.5 mm; Y -3.5 mm Z=7", ANYTHING, _typed),
        Format("published.csv", _published(), cells, IMPORTERS["ipa-ur10"]),
        Format("cleaned.csv", cleaned(), cells, IMPORTERS["ipa-ur10"]),
        Format("robot.csv", _stream(7), cells, lambda path: read_joints(path, load_robot("ur5"))),
        Format("tracker.csv", _stream(4), cells, lambda path: read_points(path, _TRACKER)),
        Format("points.txt", _points(), ANYTHING, lambda path: read_points(path, "spatial-analyzer[mm]")),
    ]
    for each in found:
        (folder / each.name).write_bytes(each.good)
    return {each.name: each for each in found}


def _regression(dataset: Dataset) -> Regression:
    """One that adds nothing, in every key of its table."""
    joints = dataset.conditions.joints
    features = evaluate(turns(joints.shape[1]), joints)
    trained = fit(features, np.zeros((len(joints), 3)), Linear(), 1.0, 1.0)
    return Regression(RegressionRequest("residuals", "turns"), (0.0, 0.0, 125.0), joints, trained, 0.01)


def _own_table(joints: Array, points: Array) -> str:
    """Some readings as people export them: names and units in one line, semicolons between."""
    names = ["Name", *(f"J{k} [deg]" for k in range(1, 7)), *(f"{axis} [mm]" for axis in "XYZ")]
    rows = [[f"P{i}", *(f"{x:.3f}" for x in (*joints[i], *points[i]))] for i in range(20)]
    return "\n".join(";".join(row) for row in [names, *rows]) + "\n"


def _workbook(text: str) -> bytes:
    """A sheet of these cells, some merged, one a formula."""
    book, out = Workbook(), io.BytesIO()
    sheet = book.active
    assert sheet is not None
    for row in (line.split(";") for line in text.splitlines()):
        sheet.append([float(cell) if cell[-1:].isdecimal() and "P" not in cell else cell for cell in row])
    sheet.append(["mean", "=AVERAGE(B2:B21)"])
    sheet.merge_cells("A23:C23")
    book.save(out)
    return out.getvalue()


def _own(folder: Path, path: Path) -> object:
    """Run `truepose convert` on a file of unknown kind, and on one of a kind that has a map."""
    try:
        return converted(read_map(folder / "map.toml"), [path], "map.toml", folder)
    except DataError:
        return propose([path], ANSWERS)


def _history() -> bytes:
    marks = dict.fromkeys(("data_sha256", "baseline_sha256", "poses_sha256"), "0123")
    line = {"format": "truepose-watch-history/1", **marks, "verdict": "unchanged", "residual": [0.5, -1.25]}
    return (json.dumps(line) + "\n").encode() * 3


def _typed(path: Path) -> object:
    """Read pasted text like the manual drivers."""
    try:
        return typed_rows(path.read_bytes().decode("utf-8", "replace"), ("X", "Y", "Z"), "mm")
    except InvalidEntry as error:
        raise ConfigError(f"mistyped: {error.words}") from error


def _corrected(saved: CalibratedModel, path: Path) -> object:
    """Run `truepose compensate` on a program."""
    known = KnownFrames()
    stated = StatedConditions(temperature_c=22.0, loads=saved.loads)
    return compensate(read_program(path, saved.model.robot, known), path, saved, stated, known)


def _targets() -> bytes:
    head = (
        "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,x_mm,y_mm,z_mm,rot_w,rot_x,rot_y,rot_z,config\n"
    )
    return (head + "A,10,-20,30,0,45,0,,,,,,,,\nB,,,,,,,300,50,400,0,0,1,0,front/up/noflip\n").encode()


_TRACKER = "time=t_s[s],x=j1_deg[mm],y=j2_deg[mm],z=j3_deg[mm]"


def _stream(columns: int) -> bytes:
    head = ["t_s", *(f"j{k}_deg" for k in range(1, columns))]
    rows = [[f"{0.1 * i:.1f}", *(f"{k + i}.5" for k in range(1, columns))] for i in range(25)]
    return "\n".join(",".join(row) for row in [head, *rows]).encode()


def _points() -> bytes:
    rows = [f"A::P::{i}, {i}.5, 2.0, -3.0, 11/22/2026 08:15:{i:02}.125" for i in range(25)]
    return "\n".join(["// SpatialAnalyzer", *rows]).encode()


def _published() -> bytes:
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    head = ["Timestamp", *(f"{name}_joint" for name in names), "measurement_temperature"]
    head += [f"measurement_{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")]
    rows = [
        [f"2020010112{k:02d}00", *("0,1",) * 6, "21,5", "100,5", "2,5", "-3", "0,1", "0,2", str(k)]
        for k in range(5)
    ]
    return "\n".join(";".join(row) for row in [head, *rows]).encode()


def cleaned() -> bytes:
    head = ["timestamp", *(f"q{k}_rad" for k in range(1, 7)), "temp_C", "x_mm", "y_mm", "z_mm"]
    head += [f"{axis}_deg_XYZintrinsic" for axis in ("rx", "ry", "rz")]
    rows = [
        [f"2020010112{k:02d}00", *("0.1",) * 6, "21.5", "1", "2", "3", "4", "5", str(k)] for k in range(5)
    ]
    return "\n".join(",".join(row) for row in [head, *rows]).encode()
