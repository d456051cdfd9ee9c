"""The documents of a folder: models, watch verdicts, diagnoses and data sets.

Each is known by its format. The files are those that the commands and the service of a cell write, without a
notification. Each is read once, and again only when its size or time has changed. A file that cannot be sent is
reported with the reason, and never stops the rest. The document itself states the robot (`device`) and the time of
measurement (`measured`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calib.arm import built_in_robots
from calib.data import read_dataset
from calib.errors import DataError
from calib.text import decoded, parse_json, parse_toml, read_bytes, read_text
from fleet.outbox.queue import LARGEST, Outbox, refuse_large
from fleet.store import Document, Kind, RobotKey, dataset_content

KINDS: Mapping[str, Kind] = {
    "truepose-model/1": "model",
    "truepose-model/2": "model",
    "truepose-watch/1": "watch",
    "truepose-diagnosis/1": "diagnosis",
    "truepose-upkeep/1": "thermal",
}
_MARK = b'"truepose-'  # every format begins so
_UNKNOWN = "names no serial number of the robot."
_NAME = 150  # letters of what may be long in an identity


@dataclass(frozen=True)
class CellFolder:
    """The cell to which the files belong.

    Attributes
    ----------
    serial
        Serial number of its robot, for documents that name none.
    simulated
        Whether documents of simulated robots are sent as well.
    """

    name: str
    serial: str = ""
    simulated: bool = False


Reader = Callable[[Path, CellFolder], Sequence[Document]]


def collect(
    folder: Path,
    cell: CellFolder,
    outbox: Outbox,
    now: Callable[[], datetime],
    say: Callable[[str], None] = lambda text: None,
    read_record: Reader = lambda path, cell: (),
) -> int:
    """Put every new document of a folder into the outbox, and return their number.

    Parameters
    ----------
    say
        Called for every file that is not accepted.
    read_record
        Reader of the databases of campaigns, which belong to another package.

    Raises
    ------
    DataError
        The outbox cannot be written; then no file is noted as read.
    """
    taken = 0
    for path, reader in _files(folder, read_record):
        stamp = _stamp(path, cell)
        if not stamp or outbox.looked_at(path, stamp):
            continue
        try:
            documents = reader(path, cell)
            for document in documents:
                refuse_large(document)
        except (DataError, OSError) as error:
            said = str(error)
            say(f"not sent: {said}")
            outbox.note(path, stamp, said)
            continue
        taken += sum(outbox.put(document, now()) for document in documents)
        outbox.note(path, stamp, "")
    return taken


def _files(folder: Path, read_record: Reader) -> Iterator[tuple[Path, Reader]]:
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        for name in sorted(names):
            path = Path(place, name)
            if name == "record.sqlite3":
                yield path, read_record
            elif path.suffix == ".json":
                yield path, read_result
            elif path.suffix == ".csv" and path.with_suffix(".toml").name in names:
                yield path, read_data


def _stamp(path: Path, cell: CellFolder) -> str:
    """Return a stamp that changes with a file, its header, its journal, or the cell.

    It is empty if the file is gone.
    """
    stamps = [cell.name, cell.serial, str(cell.simulated)]
    for each in (path, path.with_suffix(".toml"), path.with_name(f"{path.name}-wal")):
        try:
            found = each.stat()
        except OSError:
            if each is path:
                return ""
            continue
        stamps.append(f"{found.st_size} {found.st_mtime_ns}")
    return "; ".join(stamps)


def read_result(path: Path, cell: CellFolder) -> list[Document]:
    """Read the document of a JSON file; the list is empty if it has another format.

    Raises
    ------
    DataError
        The document cannot be used.
    OSError
        The file cannot be read.
    """
    content = read_bytes(path, LARGEST)
    if _MARK not in content:
        return []
    table = parse_json(content, path)
    if not isinstance(table, dict) or table.get("format") not in KINDS:
        return []
    kind = KINDS[table["format"]]
    about = table.get("data") if kind == "diagnosis" else table
    about = about if isinstance(about, dict) else {}
    _refuse_simulated(bool(about.get("simulated")), cell, path)
    devices = about.get("devices", about.get("device", []))
    measured = about.get("measured")
    document = Document(
        kind,
        _robot(str(about.get("robot", "")), devices, cell, path),
        cell.name,
        "to be named",
        _moment(measured.get("began", "") if isinstance(measured, dict) else "", path),
        content,
    )
    return [replace(document, identity=_identity(kind, table, document.hash))]


def read_data(path: Path, cell: CellFolder) -> list[Document]:
    """Read the document of a data set; the list is empty for another table.

    The whole data set is read first.

    Raises
    ------
    DataError
        The data set cannot be used.
    OSError
        A file cannot be read.
    """
    header = read_text(path.with_suffix(".toml"), LARGEST)
    if "truepose-dataset/" not in header:
        return []
    dataset = read_dataset(path)
    _refuse_simulated(dataset.header.simulated, cell, path)
    name = dataset.header.robot.name
    if name not in built_in_robots() and "robot_file" not in parse_toml(header, path.with_suffix(".toml")):
        raise DataError(
            f"is of the robot '{name}', whose file lies on this computer alone.",
            do=f'Give robot = "{name}" in {path.with_suffix(".toml").name}, and the robot file as its table '
            "[robot_file], as the export of a campaign has it.",
            file=path,
        )
    table = read_bytes(path, LARGEST)
    occasion, devices = dataset.header.occasion, dataset.header.devices
    robot = _robot(name, devices, cell, path)
    document = Document(
        "dataset",
        robot,
        cell.name,
        "to be named",
        _moment("" if occasion is None else occasion.began, path),
        dataset_content(decoded(table, path), header),
    )
    if occasion is None:
        return [replace(document, identity=f"dataset {document.hash}")]
    # One robot and one instrument measure one thing at a time: another content of the same hours contradicts it.
    named = [each.get("serial", "").strip() for each in devices]
    who = " ".join(named if robot.serial in named else (robot.serial, *named))
    return [replace(document, identity=f"dataset {who[:_NAME].strip()} {occasion.began} - {occasion.ended}")]


def _identity(kind: Kind, table: Mapping[str, Any], hash: str) -> str:
    """Return the identity of the subject of a result.

    Many models may be created from one data set, and none contradicts another; one watch has one verdict at one
    false-alarm rate.
    """
    if kind == "watch":
        model = str(table.get("model", ""))[: _NAME // 2]
        return f"watch {table.get('data_sha256', hash)} {model} {table.get('false_alarms', '')}".strip()
    return f"{kind} {hash}"


def _robot(model: str, devices: Any, cell: CellFolder, path: Path) -> RobotKey:
    serials = [
        str(each.get("serial", "")).strip()
        for each in devices
        if isinstance(each, Mapping) and each.get("role") == "robot"
    ]
    found = dict.fromkeys(serial for serial in serials if serial)
    if len(found) > 1:
        raise DataError(
            f"is of several robots ({', '.join(found)}).",
            do="Send the data sets it was merged of.",
            file=path,
        )
    serial = next(iter(found), cell.serial)
    if not serial:
        raise DataError(
            _UNKNOWN,
            do="Give it with --serial where all documents of this folder are of one robot.",
            file=path,
        )
    return RobotKey(serial, model)


def _refuse_simulated(simulated: bool, cell: CellFolder, path: Path) -> None:
    if simulated and not cell.simulated:
        raise DataError(
            "is of a simulated robot.",
            do="Give --simulated to take such documents too, into a separate store.",
            file=path,
        )


def _moment(text: str, path: Path) -> datetime:
    """Return the time at which the readings began, or the time of the file if it states none."""
    for form in ("%Y-%m-%d %H:%M UTC", "%Y-%m-%d %H:%M:%S UTC"):
        try:
            return datetime.strptime(text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC)
    return found if found.tzinfo is not None else found.replace(tzinfo=UTC)
