"""The lock on a robot: one campaign at a time, on this computer, in whatever record and whatever program.

A robot is locked by where it is (`drivers.endpoint`: however its address is written), before it is connected, and by
its maker and serial number once it has reported them, before it is armed: two addresses of one controller are one
robot. A controller that reports no serial number is known by its address alone. Stopping needs neither lock.
"""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import ExitStack
from pathlib import Path

from filelock import FileLock, Timeout

from acquisition.errors import RobotInUse
from drivers.endpoint import endpoints
from drivers.interfaces import Identity


class Mover:
    """The locks on one robot, held within a `with` block."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._held: set[str] = set()
        self._stack = ExitStack()

    def __enter__(self) -> Mover:
        """Lock the address. Raises RobotInUse where another campaign holds it, ConfigError."""
        with self._stack as locked:
            for endpoint in sorted(endpoints(self._url)):
                self._hold(locked, endpoint, f"at {self._url}")
            self._stack = locked.pop_all()
        return self

    def met(self, who: Identity) -> None:
        """Lock the robot that answered as well. Raises RobotInUse where another campaign holds it."""
        if who.serial:
            maker, serial = who.maker.casefold(), who.serial.strip().casefold()
            self._hold(self._stack, f"{maker} {serial}", f"with the serial number {who.serial}")

    def __exit__(self, *_: object) -> None:
        self._held.clear()
        self._stack.close()

    def _hold(self, stack: ExitStack, name: str, where: str) -> None:
        if name in self._held:
            return
        digest = hashlib.sha256(name.encode()).hexdigest()[:16]
        lock = FileLock(Path(tempfile.gettempdir()) / f"truepose-robot-{digest}.lock", thread_local=False)
        try:
            lock.acquire(timeout=0)
        except (Timeout, PermissionError) as error:  # the file of another user cannot even be opened
            raise RobotInUse(f"another campaign moves the robot {where}", device="robot") from error
        stack.callback(lock.release)
        self._held.add(name)
