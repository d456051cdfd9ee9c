"""The workers of a scheduler: a worker gets work when it has reported that it runs the same program.

It is asked when it is first seen, also when it joins in the middle, and then offers the resource that every batch asks
for; a worker of another program offers none, so the scheduler gives it nothing. `batch.work_off` looks once more.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from distributed import Client, Worker
from distributed.comm.core import CommClosedError

from fleet.diagnose.program import this_program

BLAS = "OPENBLAS_NUM_THREADS"


def resource(of: str) -> str:
    """The name of what a worker of this program offers: one batch at a time."""
    return f"truepose {of}"


@dataclass(frozen=True)
class Told:
    """A worker's word on itself. threads: of its linear algebra, "" where nothing limits them."""

    program: str
    threads: str


async def _enrol(expected: str, dask_worker: Worker) -> Told:
    """Enrol a worker; this runs on the worker."""
    told = Told(this_program(), os.environ.get(BLAS, ""))
    if told.program == expected:
        await dask_worker.set_resources(**{resource(expected): 1.0})
    return told


class Crew:
    """The workers seen so far: those at work, and those refused with the reason, by address."""

    def __init__(self, client: Client, expected: str) -> None:
        self._client, self._expected = client, expected
        self.at_work: set[str] = set()
        self.refused: dict[str, str] = {}
        self.lost = 0

    def look(self) -> list[str]:
        """Ask new workers for their build, drop those that are gone; sentences on both. Raises CommClosedError
        where the scheduler is gone."""
        told: Any = self._client.scheduler_info(n_workers=-1)
        if self._client.status != "running":  # then it tells what it knew last, or nothing
            raise CommClosedError("the connection to the scheduler is lost")
        present = set(told["workers"])
        said = []
        gone = self.at_work - present
        self.at_work -= gone
        self.lost += len(gone)
        said += [f"worker {address} is lost: its data sets go to others" for address in sorted(gone)]
        new = sorted(present - self.at_work - set(self.refused))
        if not new:
            return said
        answers: Any = self._client.run(_enrol, self._expected, workers=new, on_error="return")
        for address, told in answers.items():
            if isinstance(told, OSError):  # it has just gone, or is asked again
                continue
            why = self._why_not(told)
            if why:
                self.refused[address] = why
                said.append(f"worker {address} is refused: {why}")
                continue
            self.at_work.add(address)
            if told.threads != "1":
                said.append(f"worker {address} computes with more threads than one: start it with {BLAS}=1")
        return said

    def _why_not(self, told: object) -> str:
        """The reason for which a worker may not compute, from its answer; "" where it may."""
        if not isinstance(told, Told):
            return f"it cannot say which TruePose it runs ({type(told).__name__}: {told}); install {self._expected}"
        if told.program != self._expected:
            return f"it runs TruePose {told.program}, this is {self._expected}; install the same there"
        return ""
