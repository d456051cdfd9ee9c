"""The source of a data set: in files, or in the store; either way its hash is that of the store's document of it.

A job carries this reference, never the readings: a scheduler that passes on a hundred thousand data sets holds names.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.data import Dataset, read_dataset
from calib.errors import DataError
from calib.text import decoded, parse_toml, read_bytes
from fleet.store import Store, dataset_content, dataset_texts

MOST = 10_000_000  # data sets of a store


@dataclass(frozen=True)
class Source:
    """One data set. hash: of its content; name: for people; path: its CSV file, "" for the document of the store."""

    hash: str
    name: str
    path: str = ""


class Unseen(Exception):
    """The files of a data set are not what was listed, on the computer that should read them."""


def in_files(given: Sequence[Path]) -> list[Source]:
    """The data sets of files and of folders, which are searched to the bottom; each content once, in the order given.

    A file whose header is missing is one too: it will be refused. Raises DataError for a name that leads to nothing.
    """
    found: dict[str, Source] = {}
    for each in given:
        files = sorted(_within(each)) if each.is_dir() else [each]
        if not files:
            raise DataError(
                "holds no data set.", do="Name a folder with NAME.csv and NAME.toml in it.", file=each
            )
        for file in files:
            digest = file_hash(file)
            found.setdefault(digest, Source(digest, str(file), str(file.absolute())))
    return list(found.values())


def in_store(store: Store) -> list[Source]:
    """The data sets of a store, oldest first. Raises StoreError."""
    entries = reversed(store.documents(kind="dataset", limit=MOST))
    return [Source(each.hash, f"{each.robot.model} {each.robot.serial}, {each.identity}") for each in entries]


def file_hash(path: Path) -> str:
    """The hash of a data set in files: of NAME.csv, NAME.toml and the robot file that this names, where there is one.

    Without such a file, that of the store's document of it. Raises DataError for a CSV that cannot be read at all.
    """
    header_file = path.with_suffix(".toml")
    table = read_bytes(path)
    header = read_bytes(header_file) if header_file.is_file() else b""
    try:
        content = dataset_content(decoded(table, path), decoded(header, header_file))
    except DataError:  # refused when it is read; a result has a key all the same
        content = b"\0".join((table, header))
    return hashlib.sha256(content + _own_robot(header, path.parent)).hexdigest()


@contextmanager
def opened(source: Source, store: Store) -> Iterator[Dataset]:
    """The data set of a reference. Raises Unseen where the files are others than those listed, DataError for data that
    cannot be used, StoreError."""
    if source.path:
        _refuse_another(source)
        yield read_dataset(Path(source.path))
        return
    table, header = dataset_texts(store.content(source.hash))
    _refuse_own_robot(header)
    with TemporaryDirectory(prefix="truepose-fleet-") as folder:
        data = Path(folder) / "data.csv"
        data.write_text(table, "utf-8", newline="")
        data.with_suffix(".toml").write_text(header, "utf-8", newline="")
        yield read_dataset(data)


def _within(folder: Path) -> Iterator[Path]:
    return (each for each in folder.rglob("*.csv") if each.with_suffix(".toml").is_file())


def _own_robot(header: bytes, beside: Path) -> bytes:
    """The robot file that a header names; nothing where it names a robot in the box, or where it says nothing."""
    try:
        name = tomllib.loads(header.decode()).get("robot")
    except (UnicodeDecodeError, tomllib.TOMLDecodeError):
        return b""
    if not isinstance(name, str) or not name.endswith(".toml"):
        return b""
    try:
        return read_bytes(beside / name)
    except DataError:
        return b""


def _refuse_own_robot(header: str) -> None:
    """A path in a header that came from elsewhere would be looked for among the files of this computer."""
    values = parse_toml(header, "header")
    robot = values.get("robot", "")
    if isinstance(robot, str) and (robot.endswith(".toml") or "/" in robot or "\\" in robot):
        raise DataError(
            "names a file, which did not come with the data.", do="Diagnose it from its files.", key="robot"
        )


def _refuse_another(source: Source) -> None:
    try:
        now = file_hash(Path(source.path))
    except DataError as error:
        raise Unseen(f"{source.name} cannot be read here: {error}") from error
    if now != source.hash:
        raise Unseen(
            f"{source.name} is not the file that was listed: it has changed since, or is another here"
        )
