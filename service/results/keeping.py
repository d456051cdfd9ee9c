"""The findings of a service, brought into its history: runs that succeeded, diagnoses, watches, upkeeps.

The files of the record are the truth and nothing else is needed: what has not been kept is looked for again, and the
store keeps the same content once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from calib.errors import DataError
from fleet.errors import StoreError
from fleet.outbox import Cell, read_result
from fleet.store import Document, Store
from service.results.records import read_record
from service.results.robots import id_of

Outcome = Literal["new", "known", "conflict", "refused"]
_FILES = {
    "diagnoses": ("result.json", "model.json"),
    "loops": ("result.json", "model.json"),
    "watches": ("result.json", "model.json"),
    "upkeeps": ("result.json",),  # whose parameters are those of its model
}
RESULT = "result.json"
_RECORD = "record.sqlite3"
Reader = Callable[[Path, Cell], Sequence[Document]]


@dataclass(frozen=True)
class Kept:
    """The outcome for a file, by its path below the record. documents: hashes; robot_id: of the robot; because: why it
    was refused, or what it contradicts; empty otherwise."""

    path: str
    state: Outcome
    documents: tuple[str, ...] = ()
    robot_id: str = ""
    because: str = ""


def keep_results(address: str, record: Path, cell: Cell, done: Collection[str]) -> list[Kept]:
    """Keep every result of a record that is not among `done`, paths below it. Raises StoreError: what was kept before
    is known again the next time."""
    out: list[Kept] = []
    with Store.open(address) as store:
        for path, reader in _results(record):
            name = path.relative_to(record).as_posix()
            if name not in done and (kept := _keep(store, path, name, reader, cell)) is not None:
                out.append(kept)
    return out


def _results(record: Path) -> Iterator[tuple[Path, Reader]]:
    """The files that may be kept, and how each is read. A result is written last: with it everything is there."""
    for folder, names in _FILES.items():
        for place in sorted(record.glob(f"{folder}/*/")):
            if (place / RESULT).is_file():
                yield from ((place / name, read_result) for name in names if (place / name).is_file())
    for place in sorted(record.glob(f"runs/*/{_RECORD}")):
        yield place, read_record


def _keep(store: Store, path: Path, name: str, reader: Reader, cell: Cell) -> Kept | None:
    """The outcome for one file; None for what is not finished."""
    try:
        found = reader(path, cell)
        if not found:
            return None
        added = store.add_all(list(found))
    except StoreError:
        raise
    except (DataError, OSError) as error:
        return Kept(name, "refused", because=str(error).replace(str(path), name))
    hashes, robot = tuple(each.hash for each in added), id_of(found[0].robot)
    others = [hash for each in added for hash in each.other_hashes]
    if others:
        return Kept(name, "conflict", hashes, robot, f"It contradicts the document {others[-1]}.")
    state = "new" if any(each.state == "new" for each in added) else "known"
    return Kept(name, state, hashes, robot)
