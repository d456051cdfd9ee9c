"""The questions of the service to its history, by plain values: called in worker processes, which alone load the
database library.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any


def robots(address: str, due: Mapping[str, Any]) -> dict[str, Any]:
    """All robots; due: that of `DueDateRequest`. Raises DataError."""
    from service.results.robots import DueDateRequest, told_robots

    return told_robots(address, DueDateRequest(**due))


def robot(address: str, name: str, due: Mapping[str, Any], most: int) -> dict[str, Any] | None:
    """One robot, by its id or serial number; None where there is none. Raises DataError."""
    from service.results.robots import DueDateRequest, told_robot

    return told_robot(address, name, DueDateRequest(**due), most)


def trends(address: str, name: str, parameter: str | None, most: int) -> dict[str, Any] | None:
    """The trends of a robot; None where there is none. Raises DataError for a parameter that it has not."""
    from service.results.robots import told_trends

    return told_trends(address, name, parameter, most)


def content(address: str, document: str) -> bytes | None:
    """The bytes of a document; None where there is none of this hash. Raises DataError."""
    from service.results.robots import content_of

    return content_of(address, document)


def put(
    address: str, name: str, sent: bytes, header: bytes | None, cell: str, serial: str, simulated: bool
) -> dict[str, Any]:
    """Keep a document that somebody sends, with its header where it is a data set; the outcome. Raises DataError."""
    from fleet.outbox import CellFolder
    from service.results.robots import put as put_document

    return put_document(address, name, sent, header, CellFolder(cell, serial, simulated))


def keep(
    address: str, record: Path, cell: str, done: Collection[str], simulated: bool
) -> list[dict[str, Any]]:
    """Keep the results of a record that are not done; what became of each. Raises DataError."""
    from dataclasses import asdict

    from fleet.outbox import CellFolder
    from service.results.robots import keep_results

    return [asdict(each) for each in keep_results(address, record, CellFolder(cell, "", simulated), done)]
