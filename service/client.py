"""A client of the service for a cell PC: campaigns, the motion lease and its heartbeat, prompts, results.

The standard library alone, and nothing of the rest of this program: the file can be copied to another computer.

    with Client(url, token) as cell, cell.lease("anna"):
        run = cell.start(campaign)
        for run in cell.watch(run.id):
            if run.prompt:
                cell.answer(run, "confirm")

Every request has a connection of its own, so an order never waits for a long poll. What is to be done once is sent with
an `Idempotency-Key`, and sent again with the same where the answer was lost.
"""

from __future__ import annotations

import base64
import http.client
import json
import threading
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypedDict, Unpack
from urllib.parse import quote, urlencode, urlsplit

ENDED = ("succeeded", "failed", "stopped", "paused")
_TRIES, _PAUSE_S = 5, 1.0
_POLL_S = 20


class ServiceError(Exception):
    """The service refused. `status`: of HTTP; `code`: for programs; `what_to_do`: for the person at the cell."""

    def __init__(self, status: int, document: Mapping[str, Any]) -> None:
        self.status, self.document = status, dict(document)
        self.code = int(document.get("code", 0))
        self.what_to_do = str(document.get("what_to_do", ""))
        super().__init__(f"{document.get('operator_text', 'The service refused.')} {self.what_to_do}".strip())


@dataclass(frozen=True)
class ClientPrompt:
    """A question to a person, and the answers that can be given. `entry`: the numbers to be typed, where there are."""

    id: str
    text: str
    expects: tuple[str, ...]
    entry: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class ClientRun:
    """A run as it was when it was looked at. `document`: all that the service says of it."""

    id: str
    state: str
    reason: str
    version: int
    done: int
    total: int
    seconds_left: float | None
    prompt: ClientPrompt | None
    document: Mapping[str, Any] = field(repr=False)

    @property
    def ended(self) -> bool:
        """Whether the run has succeeded or failed, or rests until somebody resumes it."""
        return self.state in ENDED

    @staticmethod
    def of(document: Mapping[str, Any]) -> ClientRun:
        asked = document.get("prompt")
        prompt = None
        if asked is not None:
            prompt = ClientPrompt(asked["id"], asked["text"], tuple(asked["expects"]), asked.get("entry"))
        return ClientRun(
            id=document["id"],
            state=document["state"],
            reason=document["reason"],
            version=document["version"],
            done=document["done"],
            total=document["total"],
            seconds_left=document["seconds_left"],
            prompt=prompt,
            document=document,
        )


class ErrorLimits(TypedDict, total=False):
    """Limits of the error on readings held out, mm: RMS and largest; 0 or left out: no limit.

    accept_zones: boxes with limits of their own, as the API has them.
    """

    accept_rms_mm: float
    accept_max_mm: float
    accept_zones: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class FinishedJob:
    """A job that is over. `result`: its document; empty where it failed, then `problem` says why."""

    id: str
    kind: str
    result: Mapping[str, Any] = field(repr=False)
    problem: Mapping[str, Any] = field(repr=False)

    @property
    def succeeded(self) -> bool:
        return bool(self.result)

    @property
    def accepted(self) -> bool:
        """The error on readings held out is within the limits that were given."""
        return self.result.get("acceptance", {}).get("verdict") == "accepted"


@dataclass
class Lease:
    """The motion lease. `lost`: set once it is no longer held; `why`: the refusal then."""

    holder: str
    secret: str = field(repr=False)
    lost: threading.Event = field(default_factory=threading.Event)
    why: ServiceError | None = None


class Client:
    """The client of one service. `url`: as `truepose serve` prints it; `timeout_s`: of one request."""

    def __init__(self, url: str, token: str, *, timeout_s: float = 60.0) -> None:
        parts = urlsplit(url)
        if parts.scheme != "http" or not parts.hostname or not parts.port:
            raise ValueError(f"{url!r} is not the address of a service: http://ADDRESS:PORT")
        self._host, self._port, self._timeout_s = parts.hostname, parts.port, timeout_s
        self._token = token
        self._held: Lease | None = None

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._held = None

    # -- the lease ----------------------------------------------------------------------------------------

    @contextmanager
    def lease(self, holder: str, *, seconds: float = 30.0, every_s: float | None = None) -> Iterator[Lease]:
        """Hold the motion lease, prolonged by a thread `every_s` (default: a third of `seconds`), and give it back.

        Whatever runs pauses when it is given back. Raises Refused where another holds it.
        """
        body = {"holder": holder, "seconds": seconds}
        lease = Lease(holder, self.ask("POST", "/cell/lease", body)["lease_id"])
        self._held, ended = lease, threading.Event()
        period = seconds / 3.0 if every_s is None else every_s
        beat = threading.Thread(target=self._beat, args=(lease, body, period, ended), daemon=True)
        beat.start()
        try:
            yield lease
        finally:
            ended.set()
            beat.join()
            self._held = None
            if not lease.lost.is_set():
                self.ask("DELETE", "/cell/lease", headers={"Lease-Id": lease.secret})

    def _beat(self, lease: Lease, body: Mapping[str, Any], period: float, ended: threading.Event) -> None:
        while not ended.wait(period):
            try:
                self.ask(
                    "POST",
                    "/cell/lease",
                    body,
                    headers={"Lease-Id": lease.secret},
                    timeout_s=max(1.0, period),
                )
            except ServiceError as error:
                lease.why = error
                lease.lost.set()
                return
            except OSError:
                continue  # the network may come back before the lease ends; if not, the next answer says so

    # -- runs ---------------------------------------------------------------------------------------------

    def check(self, campaign: Mapping[str, Any]) -> ClientRun:
        """A dry run: everything is checked, nothing moves. Raises Refused with the reason."""
        return ClientRun.of(self.once("/runs", {"campaign": campaign, "dry_run": True}))

    def start(self, campaign: Mapping[str, Any], *, name: str = "", key: str = "") -> ClientRun:
        """Measure a campaign: the robot moves, so the lease must be held. key: of your own, to survive a restart."""
        return ClientRun.of(self.once("/runs", {"campaign": campaign, "dry_run": False, "name": name}, key))

    def run(self, run_id: str) -> ClientRun:
        """A run as it is now."""
        return ClientRun.of(self.ask("GET", f"/runs/{quote(run_id)}"))

    def watch(self, run_id: str) -> Iterator[ClientRun]:
        """The run at every change, until nothing goes on. Waits by long poll; a lost connection is tried again."""
        run = self.run(run_id)
        yield run
        while not run.ended:
            path = f"/runs/{quote(run_id)}?{urlencode({'wait': _POLL_S, 'after': run.version})}"
            seen, run = run.version, ClientRun.of(self._again("GET", path))
            if run.version > seen:
                yield run

    def answer(self, run: ClientRun, verb: str, *, reason: str = "", typed: str = "") -> ClientRun:
        """Answer the prompt of a run: confirm, skip, redo, pause or abort. A late or second answer is no error.

        typed: the numbers that its `entry` asks for, with confirm.
        """
        if run.prompt is None:
            return run
        path = f"/runs/{quote(run.id)}/prompts/{quote(run.prompt.id)}/{quote(verb)}"
        try:
            return ClientRun.of(self.once(path, {"reason": reason} | ({"typed": typed} if typed else {})))
        except ServiceError as error:
            if error.status == 409:
                return self.run(run.id)  # somebody was quicker
            raise

    def pause(self, run_id: str) -> ClientRun:
        """The run rests after the reading in hand."""
        return ClientRun.of(self.ask("POST", f"/runs/{quote(run_id)}/pause"))

    def resume(self, run_id: str) -> ClientRun:
        """Let a run go on: the robot moves, so the lease must be held."""
        return ClientRun.of(self.once(f"/runs/{quote(run_id)}/resume", {}))

    def stop(self, run_id: str) -> Future[list[str]]:
        """Halt the robot now. Returns at once, whatever the network does; needs no lease.

        The result of the future: what could not be stopped; its exception: the service was not reached. Not a safety
        function: press the emergency stop where the future does not say within a moment that it was heard.
        """
        heard: Future[list[str]] = Future()

        def order() -> None:
            try:
                document = self.ask("POST", f"/runs/{quote(run_id)}/stop")
            except (OSError, ServiceError) as error:
                heard.set_exception(error)
            else:
                heard.set_result([problem["message"] for problem in document.get("problems", [])])

        threading.Thread(target=order, name="stop", daemon=True).start()
        return heard

    # -- data and results ---------------------------------------------------------------------------------

    def dataset(self, run_id: str, *, name: str = "") -> str:
        """The readings of a run as a data set; its id."""
        return self.once(f"/runs/{quote(run_id)}/dataset", {"name": name})["id"]

    def identify(self, dataset_id: str, **limits: Unpack[ErrorLimits]) -> FinishedJob:
        """Identify, and wait for it."""
        return self._job("identifications", dataset_id, limits)

    def diagnose(self, dataset_id: str, **limits: Unpack[ErrorLimits]) -> FinishedJob:
        """Identify and find what the model lacks, and wait for it."""
        return self._job("diagnoses", dataset_id, limits)

    def _job(self, kind: str, dataset_id: str, limits: ErrorLimits) -> FinishedJob:
        none: ErrorLimits = {"accept_rms_mm": 0.0, "accept_max_mm": 0.0, "accept_zones": ()}
        document = self.once(f"/{kind}", {"dataset_id": dataset_id, **none, **limits})
        while document["state"] not in ("succeeded", "failed"):
            query = urlencode({"wait": _POLL_S, "after": document["version"]})
            document = self._again("GET", f"/{kind}/{document['id']}?{query}")
        return FinishedJob(
            document["id"], document["kind"], document["result"] or {}, document["problem"] or {}
        )

    def report(self, job_id: str) -> bytes:
        """The report of a job, one HTML page."""
        return self._send("GET", f"/reports/{quote(job_id)}")

    def correct(self, job_id: str, name: str, program: bytes) -> tuple[bytes, Mapping[str, Any]]:
        """A robot program corrected with the model of a job, byte for byte, and what became of its targets."""
        mark = uuid.uuid4().hex
        head = (
            f'--{mark}\r\nContent-Disposition: form-data; name="program"; filename="{quote(name)}"\r\n'
            "Content-Type: application/octet-stream\r\n\r\n"
        )
        content = head.encode() + program + f"\r\n--{mark}--\r\n".encode()
        told = json.loads(
            self._send(
                "POST",
                f"/models/{quote(job_id)}/programs",
                content,
                {"Content-Type": f"multipart/form-data; boundary={mark}"},
            )
        )
        return base64.b64decode(told["program_base64"]), told

    # -- requests -----------------------------------------------------------------------------------------

    def ask(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None = None,
        *,
        headers: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> Any:
        """One request below /api/v1 and the document of its answer. Raises Refused, OSError without an answer."""
        content = None if body is None else json.dumps(body).encode()
        typed = {} if body is None else {"Content-Type": "application/json"}
        answer = self._send(method, path, content, typed | dict(headers or {}), timeout_s)
        return json.loads(answer) if answer else None

    def once(self, path: str, body: Mapping[str, Any], key: str = "") -> Any:
        """POST with an `Idempotency-Key` (default: a new one), sent again where no answer came. Raises as `ask`."""
        headers = {"Idempotency-Key": key or uuid.uuid4().hex}
        if self._held is not None:
            headers["Lease-Id"] = self._held.secret
        return self._again("POST", path, body, headers)

    def _again(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        for _ in range(_TRIES - 1):
            try:
                return self.ask(method, path, body, headers=headers)
            except OSError:
                time.sleep(_PAUSE_S)
        return self.ask(method, path, body, headers=headers)

    def _send(
        self,
        method: str,
        path: str,
        content: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> bytes:
        timeout = self._timeout_s if timeout_s is None else timeout_s
        link = http.client.HTTPConnection(self._host, self._port, timeout=timeout)
        try:
            link.request(
                method,
                f"/api/v1{path}",
                content,
                {"Authorization": f"Bearer {self._token}", **(headers or {})},
            )
            answer = link.getresponse()
            data = answer.read()
        except http.client.HTTPException as error:  # cut off in mid-answer
            raise ConnectionError(f"the service did not answer: {error!r}") from error
        finally:
            link.close()
        if answer.status >= 400:
            raise ServiceError(answer.status, _document(data))
        return data


def _document(data: bytes) -> Mapping[str, Any]:
    try:
        document = json.loads(data)
    except ValueError:
        document = None
    return document if isinstance(document, dict) else {}
