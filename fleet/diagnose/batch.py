"""A batch of data sets for one worker: claimed, diagnosed, each result kept at once.

The results of a worker survive the worker, its scheduler and the command that requested them.

The statement kept of one diagnosis has the format `truepose-fleet-diagnosis/1`, about 5 kB, or is the refusal of data
that cannot be used. Values are in the units of files and screens; null stands for missing values.

The source of a data set is in files, or in the store; in both cases its hash is that of the store's document of it. A
job has this reference, never the readings: a scheduler that distributes a hundred thousand data sets holds names.
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
    """A reference to one data set.

    Attributes
    ----------
    hash
        Hash of its content.
    name
        Name for people.
    path
        Path of its CSV file, "" for the document of the store.
    """

    hash: str
    name: str
    path: str = ""


class DatasetMismatch(Exception):
    """The files of a data set on this computer are not those that were listed."""


def in_files(given: Sequence[Path]) -> list[DatasetSource]:
    """Return the data sets in files and in folders with their subfolders, each content once.

    The order is that of `given`. A file whose header is missing is included: it will be refused later.

    Raises
    ------
    DataError
        A name leads to no data set.
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
    """Return the data sets of a store, oldest first.

    Raises
    ------
    StoreError
        The store cannot be used.
    """
    entries = reversed(store.documents(kind="dataset", limit=MOST))
    return [
        DatasetSource(each.hash, f"{each.robot.model} {each.robot.serial}, {each.identity}")
        for each in entries
    ]


def file_hash(path: Path) -> str:
    """Compute the hash of a data set in files.

    It covers NAME.csv, NAME.toml and the robot file that this names, if any. Without such a file, it is that of the
    store's document of the data set.

    Raises
    ------
    DataError
        The CSV cannot be read at all.
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
    """Open the data set of a reference.

    Raises
    ------
    DatasetMismatch
        The files are not those listed.
    DataError
        The data cannot be used.
    StoreError
        The store cannot be used.
    """
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
    """Return the robot file that a header names.

    The result is empty if the robot is a built-in one, or if the header names none.
    """
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
    """Refuse a path in a header from another computer.

    It would be looked up among the files of this computer.
    """
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
            f"{source.name} has changed since it was listed, or is a different file on this computer"
        )


LEASE_S = 20.0
"""How long a claim holds without being renewed: so long a lost worker's data sets wait for another command."""


@dataclass(frozen=True)
class DiagnosisOrder:
    """An order for workers: data sets and the work to be done with them.

    Attributes
    ----------
    store
        Address for the results.
    owner
        Name of this run of the command.
    most
        Maximum number of effects to add.
    expected
        The program that must compute.
    """

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
        """Return the job of one data set."""
        return FleetJob(self.task, source.hash, self.expected)


@dataclass(frozen=True)
class BatchOutcome:
    """The result of a batch, in numbers of data sets.

    Attributes
    ----------
    found
        Had a result already.
    twice
        Were computed, but another result was stored first.
    seconds
        Processor time of the diagnoses.
    held
        Data sets that another call works on.
    unseen
        Data sets whose files are different here, with the reason.
    """

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
    """Do a batch.

    `find` makes the diagnosis; tests pass a shorter one.

    Raises
    ------
    EngineGone
        The worker has another program; no data was read.
    StoreError
        Results cannot be kept.
    """
    if this_program() != order.expected:
        raise EngineGone(
            f"a worker runs TruePose {this_program()}, this is {order.expected}.",
            do="Install the same version there.",
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
    """Return the statement kept of one data set: its diagnosis, or its refusal.

    Raises
    ------
    DatasetMismatch
        The files are not those listed.
    StoreError
        The store cannot be used.
    """
    try:
        with opened(source, store) as dataset:
            return statement.of_diagnosis(source.name, find(dataset, most=most))
    except StoreError:  # says nothing about the data
        raise
    except DataError as error:
        return statement.of_refusal(source.name, error)


@contextmanager
def _renewed(work: Work, jobs: Sequence[FleetJob], order: DiagnosisOrder) -> Iterator[None]:
    """Renew the claims while they are worked on, as long as this process lives."""
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
    """There is no scheduler, or no worker of the same build.

    Results so far are kept, and the call may be repeated.
    """
