"""A data set from foreign files and their map, checked against its nominal robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arm.robot import load_robot
from calib.convert.table import ConvertedTable
from calib.data.dataset import Dataset
from calib.data.header import header_of
from calib.data.plausible import read_apart_in_words, turned_apart
from calib.data.read import dataset_of
from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.map.map_file import FileMap, Map, refuse_other
from calib.foreign.proposal.proposal import Fit, fit_of, tables_of
from calib.foreign.readings.one_file import readings_of
from calib.foreign.readings.readings import table_of
from calib.text.columns import TextTable
from calib.text.toml_table import parse_toml
from calib.units import DEG

_ANOTHER = 0.1  # share of the extent of the points by which no nominal arm misses what it was measured at


@dataclass(frozen=True)
class Converted:
    """A data set from foreign files, the fit of the nominal robot to it, and remarks.

    `fit` is None if it is unknown. `said` are remarks on how the files were read.
    """

    table: ConvertedTable
    fit: Fit | None
    said: tuple[str, ...]


def converted(made: Map, paths: Sequence[Path], map_path: Path | str, beside: Path) -> Converted:
    """Convert foreign files to a data set with a map.

    Parameters
    ----------
    made : Map
        Map of the files.
    paths : sequence of Path
        The files, in the order of the map.
    map_path : Path or str
        File of the map, for error messages.
    beside : Path
        Folder to which the header's name of a robot file is relative.

    Raises
    ------
    DataError
        The map is not for these files, or a cell cannot be read; the error names file and line.
    """
    if len(paths) == 1 and len(made.files) == 2 and all(each.sheet for each in made.files):
        paths = [paths[0], paths[0]]  # two sheets of one workbook
    if len(paths) != len(made.files):
        raise DataError(
            f"is for {len(made.files)} files, and {len(paths)} are given.",
            do="Give the files that it is for.",
            file=map_path,
        )
    layouts = [_layout(each, path, map_path) for each, path in zip(made.files, paths, strict=True)]
    readings, left = readings_of(made, layouts, map_path)
    robot = load_robot(str(made.header.get("robot", "")), beside)
    readings = readings.of_robot(robot, layouts[0].sheet.shown)
    if made.header.get("measured_at_origin") is False:
        lost = (readings.points == 0.0).all(axis=1)
        readings = replace(readings, points=np.where(lost[:, None], np.nan, readings.points))
    fit = fit_of(readings, robot)
    if fit is not None and fit.own_numbers and not made.header.get("simulated", False):
        raise DataError(
            f"meets the nominal {fit.robot} to {fit.miss * 1000.0:.2g} um, better than any "
            "measured robot: these coordinates were computed by the controller.",
            do="Map the columns of the instrument; or write simulated = true under [header] where nothing "
            "was measured.",
            file=layouts[-1].sheet.shown,
        )
    if fit is not None and fit.turned_wrong:
        raise DataError(
            f"has orientations that miss those of {fit.robot} by {fit.turn / DEG:.0f} deg, although its points fit.",
            do="Correct their convention or the order of the quaternion: rotation in the map, or "
            "--answer rotation=CONVENTION ('leave' leaves them aside).",
            file=layouts[-1].sheet.shown,
        )
    named = [f"read{axis.removeprefix('j')}" for axis in robot.axes]
    read = np.column_stack([readings.numbers.get(name, np.full(len(readings), np.nan)) for name in named])
    if rods := robot.followers(readings.coupling):
        read[:, list(rods)] = np.nan
        followers = ", ".join(robot.axes[k] for k in rods)
        left = (
            *left,
            f'{followers} follow other joints by joint_coupling = "{readings.coupling}": only what they differ by is '
            "written",
        )
    apart = read_apart_in_words(turned_apart(read - readings.joints, robot.units), robot)
    left = (*left, *filter(None, [apart]))
    empty = int(np.isnan(readings.points).all(axis=1).sum())
    rejected = sum(map(bool, readings.rejected))
    for count, why in ((empty, "have no point"), (rejected, "are rejected by their status")):
        left = (
            (*left, f"{count} of {len(readings)} readings {why}: they count for nothing") if count else left
        )
    source = " and ".join(dict.fromkeys(path.name for path in paths))
    table = table_of(readings, made, map_path, source).hold_out(**made.header.get("holdout", {}))
    said = [
        f"{layout.sheet.path.name}: {each}"
        for layout in layouts
        for each in (*layout.sheet.said, *layout.said)
    ]
    return Converted(table, fit, (*said, *left))


def _layout(made: FileMap, path: Path, map_path: Path | str) -> Layout:
    found = tables_of(path, made.separator, made.sheet, made.lines)[0]
    refuse_other(made, found, map_path)
    return found


def data_set_of(table: ConvertedTable, fit: Fit | None, csv: Path, files: Sequence[Path]) -> Dataset:
    """Build the data set of a table as if it were the file `csv`, without writing it.

    Parameters
    ----------
    table : ConvertedTable
        Converted readings.
    fit : Fit or None
        Fit of the nominal robot to these readings.
    csv : Path
        Name that the file would have.
    files : sequence of Path
        Files from which the table was made.

    Raises
    ------
    DataError
        The table is no data set; the message states that the map can be changed. Or the nominal robot
        misses the readings by far, and no other explanation fits.
    """
    header = csv.with_suffix(".toml")
    try:
        found = dataset_of(
            TextTable.of_text(table.text, csv),
            header_of(parse_toml(table.header, header), header, table.header),
        )
    except (
        DataError
    ) as error:  # of files that are not written: what can be changed is the map, or the answers
        raise DataError(
            f"as they are mapped {error.what}",
            do=f"{error.do} The map's [header], or --robot and --answer, hold what is not in the files.",
            file=" and ".join(file.name for file in files),
            key=error.key,
        ) from error
    if fit is not None and fit.share > _ANOTHER:
        raise DataError(
            f"misses the nominal {fit.robot} in its best place by {fit.miss:.3g} mm, where the points spread by "
            f"{fit.extent:.3g} mm, and no built-in robot or other reading of the columns fits.",
            do="Name the robot that was measured ('truepose robot import' makes its file), or see that the joints and "
            "the point of every row are of one moment.",
            file=" and ".join(file.name for file in files),
        )
    return found
