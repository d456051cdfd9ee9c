"""Queries of the service to its history, with plain values as arguments and results.

They run in worker processes, the only ones that load the database library. `address` is the address of the store. Each
function raises `DataError` for a request that cannot be answered.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any


def robots(address: str, due: Mapping[str, Any], after: str, most: int) -> dict[str, Any]:
    """Return all robots, or a page of them. `due` holds the fields of `DueDateRequest`."""
    from service.results.robots import DueDateRequest, told_robots

    return told_robots(address, DueDateRequest(**due), after, most)


def robot(address: str, name: str, due: Mapping[str, Any], most: int) -> dict[str, Any] | None:
    """Return one robot by its id or serial number, or None if it is unknown."""
    from service.results.robots import DueDateRequest, told_robot

    return told_robot(address, name, DueDateRequest(**due), most)


def trends(address: str, name: str, parameter: str | None, most: int) -> dict[str, Any] | None:
    """Return the trends of a robot, or None if the robot is unknown.

    A parameter that the robot does not have is a `DataError`.
    """
    from service.results.robots import told_trends

    return told_trends(address, name, parameter, most)


def content(address: str, document: str) -> bytes | None:
    """Return the bytes of the document with this hash, or None if there is none."""
    from service.results.robots import content_of

    return content_of(address, document)


def put(
    address: str, name: str, sent: bytes, header: bytes | None, cell: str, serial: str, simulated: bool
) -> dict[str, Any]:
    """Keep a document that a client sends and return the outcome. A data set needs its `header`."""
    from fleet.outbox import CellFolder
    from service.results.robots import put as put_document

    return put_document(address, name, sent, header, CellFolder(cell, serial, simulated))


def keep(
    address: str, record: Path, cell: str, done: Collection[str], simulated: bool
) -> list[dict[str, Any]]:
    """Keep the results of a record that are not in `done`, and return the outcome of each."""
    from dataclasses import asdict

    from fleet.outbox import CellFolder
    from service.results.robots import keep_results

    return [asdict(each) for each in keep_results(address, record, CellFolder(cell, "", simulated), done)]
