"""The lock on a robot: one campaign at a time on this computer, for all programs.

A robot is locked by its address (`drivers.link`: in any spelling) before it is connected. Once it has reported
maker and serial number, it is locked by these before it is armed, because two addresses of one controller are one
robot. A controller that reports no serial number is known by its address alone. Stopping needs neither lock.

On Linux the lock is a name in the kernel (an abstract socket). It is the same for every user and every service,
independently of the folders that they can see; it ends with its process, and no one can delete it. Elsewhere it is a
file in the one folder that all users share, and is checked again before the robot is armed.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import socket
import struct
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from acquisition.errors import RobotInUse
from drivers.interfaces import Identity
from drivers.link import endpoints


class Mover:
    """The locks on one robot, held within a `with` block."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._held: dict[str, Callable[[], bool]] = {}  # name -> whether it is still locked
        self._stack = ExitStack()

    def __enter__(self) -> Mover:
        """Lock the address.

        Raises
        ------
        RobotInUse
            Another campaign has the lock.
        ConfigError
            The address is not valid.
        """
        with self._stack as locked:
            for endpoint in sorted(endpoints(self._url)):
                self._hold(locked, endpoint, f"at {self._url}")
            self._stack = locked.pop_all()
        return self

    def met(self, who: Identity) -> None:
        """Lock the robot that answered as well, before it is armed.

        Raises
        ------
        RobotInUse
            Another campaign has the lock, or a lock that was taken is gone.
        """
        if not all(still() for still in self._held.values()):
            raise RobotInUse(
                f"the lock of the robot at {self._url} was taken away, so another program may move it",
                device="robot",
                what_to_do=f"Find out who deletes files in {_FOLDER}, then resume.",
            )
        if who.serial:
            maker, serial = who.maker.casefold(), who.serial.strip().casefold()
            self._hold(self._stack, f"{maker} {serial}", f"with the serial number {who.serial}")

    def __exit__(self, *_: object) -> None:
        self._held.clear()
        self._stack.close()

    def _hold(self, stack: ExitStack, name: str, where: str) -> None:
        if name not in self._held:
            lock = _lock_in_kernel if sys.platform == "linux" else _lock_by_file
            self._held[name] = lock(stack, hashlib.sha256(name.encode()).hexdigest()[:16], where)


def _lock_in_kernel(stack: ExitStack, digest: str, where: str) -> Callable[[], bool]:
    address = b"\0truepose-robot-" + digest.encode()
    try:
        lock = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        lock.bind(address)
    except OSError as error:
        raise _refusal(where, _holder(address) if error.errno == errno.EADDRINUSE else "", error) from error
    lock.listen(128)  # the other program is told the process
    return lambda: True


def _holder(address: bytes) -> str:
    """Return the process that has a lock, as reported by the system, or an empty text."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asks:
        asks.setblocking(False)
        asks.connect(address)
        peer = asks.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        process, user, _ = struct.unpack("3i", peer)
        program = Path(f"/proc/{process}/comm").read_text("utf-8").strip()
        return f"{program}, process {process} of user {user}"
    return ""


def _folder() -> Path:
    """Return the folder that every user of this computer can write, independently of settings."""
    if os.name == "nt":
        return Path(os.environ.get("PROGRAMDATA", r"C:\ProgramData")) / "TruePose"
    return Path("/var/tmp/truepose")


_FOLDER = _folder()


def _lock_by_file(stack: ExitStack, digest: str, where: str) -> Callable[[], bool]:
    from filelock import FileLock, Timeout  # of the extra `cell`

    path = _FOLDER / f"robot-{digest}.lock"
    try:
        _FOLDER.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(PermissionError):  # of another user, who has opened it to all
            _FOLDER.chmod(0o1777)
        lock = FileLock(path, thread_local=False, mode=0o666)
        lock.acquire(timeout=0)
        with contextlib.suppress(PermissionError):
            path.chmod(0o666)
        stack.callback(lock.release)
        locked = path.stat()
    except Timeout as error:
        raise _refusal(where, "", None) from error
    except OSError as error:
        raise _refusal(where, "", error) from error

    def still() -> bool:
        try:
            return os.path.samestat(path.stat(), locked)
        except OSError:
            return False

    return still


def _refusal(where: str, holder: str, error: OSError | None) -> RobotInUse:
    if error is not None and error.errno != errno.EADDRINUSE:
        return RobotInUse(
            f"the robot {where} cannot be locked, and an unlocked robot is not moved: {error.strerror}",
            device="robot",
            what_to_do="Allow Unix sockets (RestrictAddressFamilies=AF_UNIX of the service)."
            if sys.platform == "linux"
            else f"Let this user write in {_FOLDER}.",
        )
    by = f" ({holder})" if holder else ""
    return RobotInUse(f"another campaign moves the robot {where}{by}", device="robot")
