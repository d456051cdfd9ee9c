"""Work on the documents of a store: the owner of each job, and its result, written once.

A job is keyed by everything that determines its result: the hash of its data, the version of the program, and the task
with its settings. A claim ends by itself, so that the job of a lost worker is done by another; a worker that finishes
late finds the result there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cached_property

import sqlalchemy as sa
from sqlalchemy import exc

from fleet.store import tables
from fleet.store.engine import reading, writing

_MANY = 1000  # keys in one question


@dataclass(frozen=True)
class FleetJob:
    """A job.

    Attributes
    ----------
    task
        The work and its settings, as text.
    data
        Hash of the document.
    program
        Version that does the work.
    """

    task: str
    data: str
    program: str

    @cached_property
    def key(self) -> str:
        """SHA-256 of the three fields, 64 hexadecimal digits."""
        return hashlib.sha256("\n".join((self.task, self.data, self.program)).encode()).hexdigest()


@dataclass(frozen=True)
class JobResult:
    """The result of a job.

    `owner` is the run that did it, `seconds` the time of the work, `content` the result.
    """

    job: FleetJob
    owner: str
    finished_at: datetime
    seconds: float
    content: bytes


class Work:
    """The jobs of a store.

    Times are arguments, with their time zone. Errors are those of the store: StoreGone, StoreError.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def claim(self, jobs: Sequence[FleetJob], owner: str, now: datetime, for_s: float) -> list[FleetJob]:
        """Claim jobs, and return those that belong to this owner from now on.

        They have no result and no other owner at this time. An owner claims its jobs again to extend them.
        """
        until = now + timedelta(seconds=for_s)
        mine: list[FleetJob] = []
        with writing(self._engine) as connection:
            for job in sorted(set(jobs) - self._done(connection, jobs), key=lambda each: each.key):
                if _taken(connection, job.key, owner, now, until):
                    mine.append(job)
        order = {job: i for i, job in enumerate(jobs)}
        return sorted(mine, key=lambda each: order[each])

    def finish(self, job: FleetJob, owner: str, content: bytes, now: datetime, seconds: float) -> bool:
        """Store the result of a job; False if it has one already, which is not changed."""
        row = {
            "key": job.key,
            "task": job.task,
            "data": job.data,
            "program": job.program,
            "owner": owner,
            "finished_at": now,
            "seconds": seconds,
            "bytes": content,
        }
        try:
            with writing(self._engine) as connection:
                connection.execute(sa.insert(tables.result), row)
        except exc.IntegrityError:
            return False
        return True

    def done(self, jobs: Sequence[FleetJob]) -> set[FleetJob]:
        """Return those of the given jobs that have a result."""
        with reading(self._engine) as connection:
            return self._done(connection, jobs)

    def results(
        self, task: str | None = None, data: str | None = None, program: str | None = None
    ) -> list[JobResult]:
        """Return results of a task, of a document, of a version, oldest first."""
        c = tables.result.c
        question = sa.select(tables.result).order_by(c.finished_at, c.key)
        for column, value in ((c.task, task), (c.data, data), (c.program, program)):
            if value is not None:
                question = question.where(column == value)
        with reading(self._engine) as connection:
            return [
                JobResult(
                    FleetJob(row.task, row.data, row.program),
                    row.owner,
                    row.finished_at,
                    row.seconds,
                    bytes(row.bytes),
                )
                for row in connection.execute(question)
            ]

    def programs(self, task: str) -> list[str]:
        """Return the versions with results of a task; the one that finished one last comes last."""
        c = tables.result.c
        question = sa.select(c.program).where(c.task == task).group_by(c.program)
        with reading(self._engine) as connection:
            return list(connection.execute(question.order_by(sa.func.max(c.finished_at))).scalars())

    def _done(self, connection: sa.Connection, jobs: Sequence[FleetJob]) -> set[FleetJob]:
        column, keys = tables.result.c.key, {job.key: job for job in jobs}
        wanted, found = list(keys), set[FleetJob]()
        for begin in range(0, len(wanted), _MANY):
            some = sa.select(column).where(column.in_(wanted[begin : begin + _MANY]))
            found |= {keys[key] for key in connection.execute(some).scalars()}
        return found


def _taken(connection: sa.Connection, key: str, owner: str, now: datetime, until: datetime) -> bool:
    """Claim one job if it is free, its claim has ended, or it is the owner's already."""
    c = tables.claim.c
    free = sa.update(tables.claim).where(c.key == key, sa.or_(c.until <= now, c.owner == owner))
    if connection.execute(free.values(owner=owner, until=until)).rowcount:
        return True
    try:
        with connection.begin_nested():
            connection.execute(sa.insert(tables.claim), {"key": key, "owner": owner, "until": until})
    except exc.IntegrityError:
        return False
    return True
