"""Data sets in Python, from their two files or from a pandas DataFrame and a header."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from calib.data import Dataset, dataset_of, header_of, read_dataset, read_header
from calib.errors import DataError
from calib.foreign import converted, data_set_of, read_map
from calib.text import TextTable
from service.extras import named
from truepose.frames import frame

if TYPE_CHECKING:
    import pandas

_IN_MEMORY = Path("DataFrame")


@dataclass(frozen=True)
class Data:
    """Readings of one robot, and the data that holds for all of them; frozen.

    `dataset` is the same data for the packages below.

    >>> data = truepose.read("irb120.csv")
    >>> len(data), data.simulated
    (120, True)
    >>> data.readings.loc[:, "x_mm":"z_mm"].shape
    (120, 3)
    """

    dataset: Dataset

    def __len__(self) -> int:
        return len(self.dataset)

    def __repr__(self) -> str:
        sets = self.dataset
        return (
            f"<{sets.name}: {len(sets)} readings of {sets.header.robot.name}, {int(sets.fit_rows.sum())} to fit, "
            f"{int(sets.validation_rows.sum())} to validate>"
        )

    @property
    def simulated(self) -> bool:
        """Whether a simulator measured the data."""
        return self.dataset.header.simulated

    @property
    def readings(self) -> pandas.DataFrame:
        """Table of the readings, one row per reading, by reading_id.

        Columns are those of the file: joints as the controller counts, mm, s, °C.
        """
        of, conditions = self.dataset, self.dataset.conditions
        robot = of.header.robot
        joints = robot.controller_angles(conditions.joints, of.header.coupling) / robot.joint_units
        columns: dict[str, Any] = {
            "set": of.sets,
            "status": of.status,
            "series": np.array(conditions.series_names)[conditions.series],
            "tool_target": np.array(conditions.target_names)[conditions.target],
            **dict(zip(robot.joint_columns, joints.T, strict=True)),
            **{f"{axis}_mm": of.points[:, k] for k, axis in enumerate("xyz")},
            "length_mm": of.lengths,
            "t_s": conditions.time,
            "t_air_c": conditions.temperature,
        }
        return frame(columns, of.reading_id, "reading_id")


@named()
def read(
    source: str | Path | Sequence[str | Path] | pandas.DataFrame,
    header: Mapping[str, Any] | str | Path | None = None,
    *,
    map: str | Path | None = None,
) -> Data:
    """Read a data set.

    Parameters
    ----------
    source :
        `NAME.csv`, with `NAME.toml` in the same folder. Or a DataFrame with the columns of such a file, units in
        their names (`j1_deg`, `x_mm`). If its index has a name, it is the reading_id. With a map, a file of another
        program, or two, one with joints and one with points.
    header :
        For a DataFrame, the table that the .toml would hold, or the file itself.
    map :
        Map of the columns of foreign files (`truepose-map/1`), as `truepose convert FILE --propose` writes it.
        Files that `truepose convert` refuses are refused.

    Raises
    ------
    DataError
        The data cannot be used. The message names file, line or key, and the remedy.
    ImportError
        The file needs a package that is not installed; the message names its extra.

    >>> truepose.read("irb120.csv")
    <irb120.csv: 120 readings of abb-irb120, 80 to fit, 40 to validate>
    >>> truepose.read("irb121.csv")
    Traceback (most recent call last):
    calib.errors.DataError: irb121.csv: there is no such file. Check the name.
    """
    if map is not None:
        return Data(_by_map(source, Path(map), header))
    if isinstance(source, str | Path):
        if header is not None:
            raise DataError(
                "is read with the header in its own folder.",
                do="Give a header with a DataFrame only.",
                file=source,
                key="header",
            )
        return Data(read_dataset(source))
    if _several(source):
        raise DataError("several files need a map.", do="Give map=, or one file.", key="source")
    if isinstance(source, Sequence) or not hasattr(source, "to_csv"):
        raise DataError(
            f"is {type(source).__name__}.", do="Give the name of a .csv file, or a DataFrame.", key="source"
        )
    if header is None:
        raise DataError(
            "a DataFrame needs a header.", do="Give header=, a table or a .toml file.", key="header"
        )
    table = source if source.index.name is None else source.reset_index()
    text = table.to_csv(index=False)
    if isinstance(header, Mapping):
        written, path = tomli_w.dumps(dict(header)), _IN_MEMORY.with_suffix(".toml")
        return Data(dataset_of(TextTable.of_text(text, _IN_MEMORY), header_of(header, path, written)))
    return Data(dataset_of(TextTable.of_text(text, _IN_MEMORY), read_header(Path(header))))


def _several(source: object) -> bool:
    return isinstance(source, list | tuple) and all(isinstance(each, str | Path) for each in source)


def _by_map(source: Any, map_path: Path, header: object) -> Dataset:
    """Return the data set of foreign files, in memory.

    A robot file is named relative to the folder of the map.
    """
    if header is not None:
        raise DataError("contains the header.", do="Leave header= out.", file=map_path, key="header")
    given = [source] if isinstance(source, str | Path) else source
    if not isinstance(given, list | tuple) or not all(isinstance(each, str | Path) for each in given):
        raise DataError(
            "can be used with names of files only.", do="Give one file, or a list of two.", key="map"
        )
    files = [Path(each) for each in given]
    found = converted(read_map(map_path), files, map_path, map_path.parent)
    return data_set_of(found.table, found.fit, map_path.with_name(f"{files[0].stem}.csv"), files)


def data_of(source: Data | str | Path) -> Data:
    """Return a data set, or read the file of that name.

    Raises
    ------
    DataError
        The file cannot be used.
    """
    return source if isinstance(source, Data) else read(source)
