"""The settings that the service was started with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from acquisition import Cell
from service.http.access.roles import Tokens
from service.simulated_cell import SimulatedDevices

UPLOAD_BYTES = 32 * 1024 * 1024  # 100,000 readings have some 20 MB


@dataclass(frozen=True)
class Settings:
    """`record`: the folder that holds everything. `token_file`: where the tokens are kept.

    `simulated` None: the real devices of `cell`. `store`: address of the history, None for a file of the record;
    `permitted_mm`: position error, RMS, by which dates of checks are reckoned.
    """

    record: Path
    tokens: Tokens
    token_file: Path | None = None
    cell: Cell | None = None
    simulated: SimulatedDevices | None = None
    host: str = "127.0.0.1"
    upload_bytes: int = UPLOAD_BYTES
    store: str | None = field(default=None, repr=False)
    permitted_mm: float | None = None
