"""Start the service for the tests.

It runs in a separate process, on a free port, with a client that has its token.
"""

from __future__ import annotations

import json
import os
import random
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import httpx2

from tests.drivers.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]
TOKEN = "only-for-the-tests-of-truepose"
MEDIA_TYPE = "application/problem+json"


@dataclass
class Served:
    """Running service.

    `client` has the operator's token and begins with the prefix of the API, `anybody` neither.
    """

    process: subprocess.Popen[str]
    url: str
    client: httpx2.Client
    anybody: httpx2.Client
    hello: dict[str, str]

    def until(self, path: str, *states: str, seconds: float = PATIENCE_S) -> dict[str, Any]:
        """Long-poll a run or a job until it is in one of these states."""
        end, version = time.monotonic() + seconds, 0
        while True:
            answer = self.client.get(path, params={"wait": 5, "after": version})
            assert answer.status_code == 200, answer.text
            document = answer.json()
            if document["state"] in states:
                return document
            assert time.monotonic() < end, document
            version = document["version"]

    def begin(self, campaign: dict[str, Any]) -> str:
        """The number of a run that drives; the client has the lease."""
        self.lease()
        return self.client.post("/runs", json={"campaign": campaign, "dry_run": False}).json()["id"]

    def lease(self, holder: str = "anna", seconds: float = 300.0) -> dict[str, Any]:
        """Take the lease, or prolong it if this holder has it.

        The client sends the lease's secret from now on.
        """
        held = self.client.get("/cell").json()["lease"]
        if held is None or held["holder"] != holder:
            self.client.headers.pop("Lease-Id", None)
        answer = self.client.post("/cell/lease", json={"holder": holder, "seconds": seconds})
        assert answer.status_code == 200, answer.text
        if answer.json()["lease_id"]:
            self.client.headers["Lease-Id"] = answer.json()["lease_id"]
        return answer.json()

    def free(self) -> None:
        """Take the lease from its holder, which pauses the holder's runs, and give it back."""
        because = {"holder": "the tests", "reason": "this one has ended"}
        taken = self.client.post("/cell/lease/takeover", json=because).json()
        self.client.delete("/cell/lease", headers={"Lease-Id": taken["lease_id"]})
        self.client.headers.pop("Lease-Id", None)


def lasting_port() -> int:
    """Return a free port below those that the system assigns on request.

    A service that has ended can come back on it, because no other test has been given it meanwhile.
    """
    while True:
        with socket.socket() as free, suppress(OSError):
            free.bind(("127.0.0.1", random.randrange(20_000, 32_000)))
            return free.getsockname()[1]


@contextmanager
def served(
    record: Path, *options: str, files: int | None = None, folder: Path | None = None
) -> Iterator[Served]:
    """Run `truepose serve --record RECORD ...` in a folder until the block ends.

    `files` limits how many files it may open; then its log goes to `record.log`, in the same folder as the record.
    """
    command = [
        sys.executable,
        "-P",
        "-m",
        "service.cli",
        "serve",
        "--json",
        "--record",
        str(record),
        *options,
    ]
    env = os.environ | {"TRUEPOSE_TOKEN": TOKEN, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
    limited = None if files is None else partial(resource.setrlimit, resource.RLIMIT_NOFILE, (files, files))
    log = None if files is None else record.with_suffix(".log").open("w")
    with (
        log or nullcontext(),
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=log, text=True, env=env, preexec_fn=limited, cwd=folder
        ) as process,
    ):
        try:
            assert process.stdout is not None
            hello = json.loads(process.stdout.readline())
            assert hello["token"] == TOKEN
            token = {"Authorization": f"Bearer {TOKEN}"}
            with (
                httpx2.Client(base_url=f"{hello['url']}/api/v1", headers=token, timeout=PATIENCE_S) as client,
                httpx2.Client(base_url=hello["url"], timeout=PATIENCE_S) as anybody,
            ):
                yield Served(process, hello["url"], client, anybody, hello)
        finally:
            process.terminate()


def problem(answer: httpx2.Response, status: int) -> dict[str, Any]:
    """The document of an error, which must be one by the contract."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == MEDIA_TYPE
    document = json.loads(answer.text, parse_constant=_refuse)
    assert document["status"] == status
    for key in ("type", "title", "detail", "operator_text", "what_to_do"):
        assert isinstance(document[key], str)
        assert document[key]
    assert isinstance(document["code"], int)
    return document


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} in JSON")
