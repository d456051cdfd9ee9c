"""A batch of data sets, as a worker does it: claimed in the store, diagnosed one by one, each result kept at once.

What a worker has finished survives the worker, its scheduler and the command that asked for it.

The statement kept of one diagnosis: `truepose-fleet-diagnosis/1`, some 5 kB, or the refusal of data that cannot be
used.

Values are in the units of files and screens; null stands for what there is not.

The source of a data set: in files, or in the store; either way its hash is that of the store's document of it.

A job carries this reference, never the readings: a scheduler that passes on a hundred thousand data sets holds names.

The refusal of the engine that computes.
"""

from __future__ import annotations

import hashlib
import json
import threading
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from calib.data import Dataset, read_dataset
from calib.diagnose import MOST_EFFECTS, DiagnosisFit, diagnose
from calib.errors import DataError
from calib.text import decoded, parse_toml, read_bytes
from fleet.diagnose import statement
from fleet.diagnose.changes import this_program
from fleet.errors import StoreError, StoreGone
from fleet.store import FleetJob, FleetStore, Work, dataset_content, dataset_texts, utc_now
from fleet.store.rediagnosed import TASK

MOST = 10_000_000  # data sets of a store


@dataclass(frozen=True)
class DatasetSource:
    """One data set. hash: of its content; name: for people; path: its CSV file, "" for the document of the store."""

    hash: str
    name: str
    path: str = ""


class DatasetMismatch(Exception):
    """The files of a data set are not what was listed, on the computer that should read them."""


def in_files(given: Sequence[Path]) -> list[DatasetSource]:
    """The data sets of files and of folders, which are searched to the bottom; each content once, in the order given.

    A file whose header is missing is one too: it will be refused. Raises DataError for a name that leads to nothing.
    """
    found: dict[str, DatasetSource] = {}
    for each in given:
        files = sorted(_within(each)) if each.is_dir() else [each]
        if not files:
            raise DataError(
                "holds no data set.", do="Name a folder with NAME.csv and NAME.toml in it.", file=each
            )
        for file in files:
            digest = file_hash(file)
            found.setdefault(digest, DatasetSource(digest, str(file), str(file.absolute())))
    return list(found.values())


def in_store(store: FleetStore) -> list[DatasetSource]:
    """The data sets of a store, oldest first. Raises StoreError."""
    entries = reversed(store.documents(kind="dataset", limit=MOST))
    return [
        DatasetSource(each.hash, f"{each.robot.model} {each.robot.serial}, {each.identity}")
        for each in entries
    ]


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
def opened(source: DatasetSource, store: FleetStore) -> Iterator[Dataset]:
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


def _refuse_another(source: DatasetSource) -> None:
    try:
        now = file_hash(Path(source.path))
    except DataError as error:
        raise DatasetMismatch(f"{source.name} cannot be read here: {error}") from error
    if now != source.hash:
        raise DatasetMismatch(
            f"{source.name} is not the file that was listed: it has changed since, or is another here"
        )


LEASE_S = 20.0
"""How long a claim holds without being renewed: so long a lost worker's data sets wait for another command."""


@dataclass(frozen=True)
class DiagnosisOrder:
    """An order for workers: data sets and what to do with them. store: address for the results; owner: name of this run
    of the command; most: effects that may be added; expected: the program that shall compute."""

    store: str = field(repr=False)  # may hold a password
    owner: str
    most: int = MOST_EFFECTS
    expected: str = field(default_factory=this_program)
    lease_s: float = LEASE_S

    @property
    def task(self) -> str:
        """The task with its settings, as the store keys it."""
        return TASK if self.most == MOST_EFFECTS else f"{TASK} most={self.most}"

    def job(self, source: DatasetSource) -> FleetJob:
        """The job of one data set."""
        return FleetJob(self.task, source.hash, self.expected)


@dataclass(frozen=True)
class BatchOutcome:
    """The outcome of a batch, in data sets. found: had a result already; twice: computed, though a result of somebody
    else was there when it came; seconds: processor time of the diagnoses; held: somebody else works on them; unseen:
    their files are others here, with the reason."""

    done: int
    refused: int
    found: int
    twice: int
    seconds: float
    held: tuple[DatasetSource, ...]
    unseen: tuple[tuple[DatasetSource, str], ...]


def work_off(
    sources: Sequence[DatasetSource], order: DiagnosisOrder, find: Callable[..., DiagnosisFit] = diagnose
) -> BatchOutcome:
    """Do a batch. Raises EngineGone on a worker of another program, before anything is read; StoreError where results
    cannot be kept.

    find: the diagnosis; tests give a shorter one.
    """
    if this_program() != order.expected:
        raise EngineGone(
            f"a worker runs TruePose {this_program()}, this is {order.expected}.",
            do="Install the same there.",
        )
    jobs = {order.job(source): source for source in sources}
    refused = twice = done = 0
    seconds = 0.0
    unseen: list[tuple[DatasetSource, str]] = []
    with FleetStore.open(order.store) as store:
        mine = store.work.claim(list(jobs), order.owner, utc_now(), order.lease_s)
        with _renewed(store.work, mine, order):
            for job in mine:
                begin = time.thread_time()
                try:
                    result = _statement(jobs[job], store, order.most, find)
                except DatasetMismatch as error:
                    unseen.append((jobs[job], str(error)))
                    continue
                spent = time.thread_time() - begin
                content = json.dumps(result, allow_nan=False).encode()
                if store.work.finish(job, order.owner, content, utc_now(), spent):
                    done += 1
                    refused += result["verdict"] == statement.REFUSED
                else:
                    twice += 1
                seconds += spent
        others = set(jobs) - set(mine)
        found = store.work.done(list(others))
    held = tuple(source for job, source in jobs.items() if job in others - found)
    return BatchOutcome(done, refused, len(found), twice, seconds, held, tuple(unseen))


def _statement(
    source: DatasetSource, store: FleetStore, most: int, find: Callable[..., DiagnosisFit]
) -> dict[str, Any]:
    """The statement kept of one data set: its diagnosis, or its refusal. Raises Unseen, StoreError."""
    try:
        with opened(source, store) as dataset:
            return statement.of_diagnosis(source.name, find(dataset, most=most))
    except StoreError:  # says nothing about the data
        raise
    except DataError as error:
        return statement.of_refusal(source.name, error)


@contextmanager
def _renewed(work: Work, jobs: Sequence[FleetJob], order: DiagnosisOrder) -> Iterator[None]:
    """The claims renewed while they are worked on, as long as this process lives."""
    over = threading.Event()

    def renew() -> None:
        while not over.wait(order.lease_s / 3.0):
            try:
                work.claim(jobs, order.owner, utc_now(), order.lease_s)
            except StoreGone:  # the result will say so, if the store stays away
                continue

    thread = threading.Thread(target=renew, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class EngineGone(DataError):
    """There is no scheduler, or no worker of the same build. Results so far are kept, and the call may be repeated."""
