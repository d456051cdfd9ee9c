"""Orders to stop, written to the record while the order goes to the robot.

The disk may take longer than the robot. The thread that ends the run waits for these entries, so that the record names
the person who stopped it before it has the stopped state. An entry that could not be written is tried again then.
"""

from __future__ import annotations

import threading

from acquisition.errors import StorageError
from acquisition.record.store import RecordStore


class StopOrders:
    """The orders to stop one execution.

    `begin` and `finish` exclude each other: their caller holds a lock.
    """

    def __init__(self, store: RecordStore) -> None:
        self._store = store
        self._threads: list[threading.Thread] = []
        self._left: list[tuple[str, str | None]] = []

    def begin(self, by: str, key: str | None) -> None:
        """Write, in a separate thread, that `by` has requested a stop, with this idempotency key."""
        thread = threading.Thread(target=self._note, args=(by, key), name="noting")
        self._threads.append(thread)
        thread.start()

    def _note(self, by: str, key: str | None) -> None:
        try:
            self._store.command("stop", by, key)
        except StorageError:
            self._left.append((by, key))

    def finish(self) -> None:
        """Wait until every order is durable.

        Raises
        ------
        StorageError
            The record still cannot be written.
        """
        for thread in self._threads:
            thread.join()
        for by, key in self._left:
            self._store.command("stop", by, key)
