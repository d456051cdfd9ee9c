"""Client of the TruePose service for programs on a cell PC.

It runs campaigns, holds the motion lease with its heartbeat, answers prompts and fetches results. It uses only the
standard library and no other part of this program, so the file can be copied to another computer.

    with Client(url, token) as cell, cell.lease("anna"):
        run = cell.start(campaign)
        for run in cell.watch(run.id):
            if run.prompt:
                cell.answer(run, "confirm")

Every request uses a separate connection, so a command never waits for a long poll. A request that must take effect only
once carries an `Idempotency-Key`. It is sent again with the same key if the answer is lost.
"""

from __future__ import annotations

import base64
import http.client
import json
import re
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
    """A refusal by the service.

    Attributes
    ----------
    status : int
        HTTP status.
    document : dict
        Whole answer of the service.
    code : int
        Number of the error, for programs; 0 if the service gave none.
    what_to_do : str
        Remedy, for the person at the cell.
    """

    def __init__(self, status: int, document: Mapping[str, Any]) -> None:
        self.status, self.document = status, dict(document)
        self.code = int(document.get("code", 0))
        self.what_to_do = str(document.get("what_to_do", ""))
        super().__init__(f"{document.get('operator_text', 'The service refused.')} {self.what_to_do}".strip())


@dataclass(frozen=True)
class ClientPrompt:
    """A question to a person.

    Attributes
    ----------
    expects : tuple of str
        Answers that can be given.
    entry : mapping or None
        Description of the numbers to be typed; None if the prompt asks for none.
    """

    id: str
    text: str
    expects: tuple[str, ...]
    entry: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class ClientRun:
    """Snapshot of a run.

    Attributes
    ----------
    version : int
        Number that grows with every change of the run.
    done, total : int
        Finished and planned readings.
    document : mapping
        Whole answer of the service about the run.
    """

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
        """Whether the run has succeeded or failed, or is at rest until it is resumed."""
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
    """Limits of the error on held-out readings.

    Attributes
    ----------
    accept_rms_mm, accept_max_mm : float
        Limits of the RMS and of the largest error, mm. No limit if 0 or omitted.
    accept_zones : sequence of mapping
        Boxes with separate limits, in the format of the API.
    """

    accept_rms_mm: float
    accept_max_mm: float
    accept_zones: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class FinishedJob:
    """A job that has ended.

    Attributes
    ----------
    result : mapping
        Result document; empty if the job failed.
    problem : mapping
        Reason of the failure; empty if the job succeeded.
    """

    id: str
    kind: str
    result: Mapping[str, Any] = field(repr=False)
    problem: Mapping[str, Any] = field(repr=False)

    @property
    def succeeded(self) -> bool:
        return bool(self.result)

    @property
    def accepted(self) -> bool:
        """Whether the error on held-out readings is within the given limits."""
        return self.result.get("acceptance", {}).get("verdict") == "accepted"


@dataclass
class Lease:
    """The motion lease.

    Attributes
    ----------
    lost : threading.Event
        Set when the service no longer grants the lease.
    why : ServiceError or None
        Refusal with which the lease was lost.
    """

    holder: str
    secret: str = field(repr=False)
    lost: threading.Event = field(default_factory=threading.Event)
    why: ServiceError | None = None


class Client:
    """Client of one service.

    Parameters
    ----------
    url : str
        Address of the service, as `truepose serve` prints it.
    token : str
        Token of the service.
    timeout_s : float
        Timeout of one request, s.
    """

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
        """Hold the motion lease during the block, then give it back.

        A thread renews the lease every `every_s` seconds (default: a third of `seconds`). A run that is under way
        pauses when the lease is given back.

        Raises
        ------
        ServiceError
            Another client holds the lease.
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
        """Start a dry run, which checks everything and moves nothing.

        Raises
        ------
        ServiceError
            The campaign cannot be run; the error holds the reason.
        """
        return ClientRun.of(self.once("/runs", {"campaign": campaign, "dry_run": True}))

    def start(self, campaign: Mapping[str, Any], *, name: str = "", key: str = "") -> ClientRun:
        """Measure a campaign.

        The robot moves, so the lease must be held. Pass your own idempotency `key` to start the run only once even if
        your program restarts.
        """
        return ClientRun.of(self.once("/runs", {"campaign": campaign, "dry_run": False, "name": name}, key))

    def run(self, run_id: str) -> ClientRun:
        """Fetch the current state of a run."""
        return ClientRun.of(self.ask("GET", f"/runs/{quote(run_id)}"))

    def watch(self, run_id: str) -> Iterator[ClientRun]:
        """Yield the run after every change until it has ended or is paused.

        Changes are awaited by long poll. A lost connection is tried again.
        """
        run = self.run(run_id)
        yield run
        while not run.ended:
            path = f"/runs/{quote(run_id)}?{urlencode({'wait': _POLL_S, 'after': run.version})}"
            seen, run = run.version, ClientRun.of(self._again("GET", path))
            if run.version > seen:
                yield run

    def answer(self, run: ClientRun, verb: str, *, reason: str = "", typed: str = "") -> ClientRun:
        """Answer the prompt of a run. A late or second answer is not an error.

        Parameters
        ----------
        run : ClientRun
            Run with the prompt. Without a prompt nothing is sent.
        verb : str
            `confirm`, `skip`, `redo`, `pause` or `abort`.
        reason : str
            Reason to be recorded.
        typed : str
            Numbers that the `entry` of the prompt requests, with `confirm`.
        """
        if run.prompt is None:
            return run
        path = f"/runs/{quote(run.id)}/prompts/{quote(run.prompt.id)}/{quote(verb)}"
        try:
            return ClientRun.of(self.once(path, {"reason": reason} | ({"typed": typed} if typed else {})))
        except ServiceError as error:
            if error.status == 409:
                return self.run(run.id)  # another client answered first
            raise

    def pause(self, run_id: str) -> ClientRun:
        """Pause a run after the current reading."""
        return ClientRun.of(self.ask("POST", f"/runs/{quote(run_id)}/pause"))

    def finish(self, run_id: str, *, reason: str = "") -> ClientRun:
        """End a run early, as succeeded, after the current reading."""
        return ClientRun.of(self.once(f"/runs/{quote(run_id)}/finish", {"reason": reason}))

    def resume(self, run_id: str) -> ClientRun:
        """Resume a run. The robot moves, so the lease must be held."""
        return ClientRun.of(self.once(f"/runs/{quote(run_id)}/resume", {}))

    def stop(self, run_id: str) -> Future[list[str]]:
        """Halt the robot now. No lease is needed.

        The call returns at once, even if the network does not respond. This is not a safety function: press the
        emergency stop if the future does not confirm the stop within a moment.

        Returns
        -------
        Future
            Its result lists the devices that could not be stopped. Its exception means that the service was not reached
            or refused.
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
        """Create a data set from the readings of a run and return its id."""
        return self.once(f"/runs/{quote(run_id)}/dataset", {"name": name})["id"]

    def identify(self, dataset_id: str, **limits: Unpack[ErrorLimits]) -> FinishedJob:
        """Identify the parameters of the robot and wait for the result."""
        return self._job("identifications", dataset_id, limits)

    def diagnose(self, dataset_id: str, **limits: Unpack[ErrorLimits]) -> FinishedJob:
        """Identify the robot, search for effects that the model lacks, and wait for the result."""
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

    def each(self, collection: str, *, limit: int = 100) -> Iterator[Mapping[str, Any]]:
        """Yield the documents of a list such as `runs`, `datasets` or `deletions`.

        Each request asks for `limit` of them. Documents that exist all the time come once, even if others are added or
        deleted meanwhile.

        Raises
        ------
        ServiceError
            There is no such list, or `limit` is not between 1 and 500.
        """
        member = collection.rsplit("/", 1)[-1].replace("-", "_")
        path = f"/{quote(collection)}?{urlencode({'limit': limit})}"
        while path:
            data, link = self._answer("GET", path)
            yield from json.loads(data)[member]
            found = re.search(r'</api/v1(/[^>]*)>; *rel="next"', link)
            path = "" if found is None else found[1]

    def report(self, job_id: str) -> bytes:
        """Fetch the report of a job, one HTML page."""
        return self._send("GET", f"/reports/{quote(job_id)}")

    def correct(self, job_id: str, name: str, program: bytes) -> tuple[bytes, Mapping[str, Any]]:
        """Correct a robot program with the model of a job.

        Returns
        -------
        program : bytes
            Corrected program, byte for byte as the service created it.
        document : mapping
            Whole answer of the service, with the outcome of each target.
        """
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
        """Send one request below `/api/v1` and return the document of its answer, or None if empty.

        Raises
        ------
        ServiceError
            The service refused the request.
        OSError
            No answer was received.
        """
        content = None if body is None else json.dumps(body).encode()
        typed = {} if body is None else {"Content-Type": "application/json"}
        answer = self._send(method, path, content, typed | dict(headers or {}), timeout_s)
        return json.loads(answer) if answer else None

    def once(self, path: str, body: Mapping[str, Any], key: str = "") -> Any:
        """Send a POST request with an `Idempotency-Key`, again if no answer is received.

        Without `key`, a new one is created. The errors are those of `ask`, after the last attempt.
        """
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
        return self._answer(method, path, content, headers, timeout_s)[0]

    def _answer(
        self,
        method: str,
        path: str,
        content: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> tuple[bytes, str]:
        """Send one request and return the body of its answer, and its `Link`."""
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
        except http.client.HTTPException as error:  # the answer was truncated
            raise ConnectionError(f"the service did not answer: {error!r}") from error
        finally:
            link.close()
        if answer.status >= 400:
            raise ServiceError(answer.status, _document(data))
        return data, answer.getheader("Link", "")


def _document(data: bytes) -> Mapping[str, Any]:
    try:
        document = json.loads(data)
    except ValueError:
        document = None
    return document if isinstance(document, dict) else {}
