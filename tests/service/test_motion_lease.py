"""The motion lease.

Its secret is given once, every motion needs it, and it is taken from its holder on purpose only. These would catch: a
secret for anyone who knows the holder's name, a lease that another client gives back, and a run that moves without the
secret while another holds the lease. They would also catch a route that moves without the lease, a lease granted
again to a request that came too late, and a takeover that leaves no trace.
"""

from __future__ import annotations

import hmac
import json
from collections.abc import Iterator
from pathlib import Path

import anyio
import httpx2
import pytest

import acquisition
from acquisition.errors import StorageError
from service.http.access.audit import FILE, Audit
from service.http.access.motion_lease import MotionLease
from service.http.access.roles import ServiceSettings, Tokens
from service.http.state import Service
from service.http.wire.problems import Problem
from tests.changing_files import looked_at
from tests.drivers.waiting import until
from tests.service.lease_clock import LeaseClock
from tests.service.test_http import CAMPAIGN, CELL
from tests.service.test_http_support import Served, problem, served

MOTIONS = {"createRun", "resumeRun", "retakeVisit"}
MOTIONS |= {f"{order}{work}" for order in ("create", "resume") for work in ("Loop", "Verification")}
OWN_LEASE = {"takeLease", "giveLeaseBack"}
DELETIONS = {"deleteCampaign", "deleteDataset", "deleteResult", "deleteRun"}
# they move nothing by themselves
NAMED_BY_IT = {"answerPrompt", "finishRun", "restationRun", "skipVisit", *DELETIONS}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("record"), "--cell", str(CELL)) as running:
        yield running


def take(service: Served, holder: str, lease_id: str = "", **headers: str) -> httpx2.Response:
    """Take the lease as a client that knows only the secret that is given here."""
    sent = headers | ({"Lease-Id": lease_id} if lease_id else {})
    return service.client.post("/cell/lease", json={"holder": holder, "seconds": 120.0}, headers=sent)


def record_of(service: Served) -> Path:
    return Path(service.hello["token_file"]).parent


@pytest.fixture
def mine(service: Served) -> Iterator[str]:
    """The secret of anna's lease."""
    answer = take(service, "anna")
    assert answer.status_code == 200, answer.text
    yield answer.json()["lease_id"]
    service.free()


# -- by HTTP --------------------------------------------------------------------------------------------------


def test_the_secret_is_given_once(service: Served, mine: str) -> None:
    assert len(mine) >= 22  # 128 bits at least
    held = problem(take(service, "anna"), 409)
    assert (held["code"], held["holder"]) == (8102, "anna")
    assert 0 < held["retry_after_s"] <= 120
    renewed = take(service, "anna", mine)
    assert (renewed.status_code, renewed.json()["lease_id"]) == (200, "")
    assert service.client.get("/cell").json()["lease"]["lease_id"] == ""
    assert mine not in held["detail"] + held["what_to_do"]


def test_a_repeated_request_is_not_given_the_secret_again(service: Served) -> None:
    key = {"Idempotency-Key": "lease-1"}
    secret = take(service, "anna", **key).json()["lease_id"]
    again = problem(take(service, "anna", **key), 409)
    assert secret not in json.dumps(again)
    kept = looked_at(record_of(service), lambda path: path.read_bytes() if path.is_file() else b"")
    assert record_of(service) / FILE in kept
    assert not [file for file, content in kept.items() if secret.encode() in content]
    assert service.client.delete("/cell/lease", headers={"Lease-Id": secret}).status_code == 204


def test_only_its_holder_gives_it_back(service: Served, mine: str) -> None:
    for lease_id in ("", "0123456789abcdef", b"\xe9", mine[:-1]):
        headers = {"Lease-Id": lease_id} if lease_id else {}
        assert problem(service.client.delete("/cell/lease", headers=headers), 409)["code"] == 8102  # type: ignore[arg-type]
    assert service.client.get("/cell").json()["lease"]["holder"] == "anna"
    assert service.client.delete("/cell/lease", headers={"Lease-Id": mine}).status_code == 204
    assert service.client.get("/cell").json()["lease"] is None
    assert service.client.delete("/cell/lease").status_code == 204  # said twice
    late = problem(take(service, "anna", mine), 409)  # a renewal that was under way
    assert (late["code"], "has ended" in late["detail"]) == (8112, True)
    assert service.client.get("/cell").json()["lease"] is None


@pytest.mark.parametrize("path", ["/runs", "/loops"])
def test_what_moves_needs_the_secret(service: Served, path: str) -> None:
    order = {"campaign": CAMPAIGN, "dry_run": False}
    assert problem(service.client.post(path, json=order), 409)["code"] == 8101
    answer = take(service, "anna").json()
    for headers in ({}, {"Lease-Id": ""}, {"Lease-Id": "anna"}):
        refused = problem(service.client.post(path, json=order, headers=headers), 409)
        assert (refused["code"], refused["holder"]) == (8102, "anna")
    assert service.client.get(path).json()[path[1:]] == []
    service.client.delete("/cell/lease", headers={"Lease-Id": answer["lease_id"]})


def test_every_route_that_moves_asks_for_it(service: Served) -> None:
    """A new route that posts has to be put into one of the sets."""
    document = service.anybody.get("/openapi.json").json()
    asks = {
        operation["operationId"]
        for item in document["paths"].values()
        for operation in item.values()
        if any(each["name"] == "Lease-Id" for each in operation.get("parameters", ()))
    }
    assert asks == MOTIONS | OWN_LEASE | NAMED_BY_IT


def test_a_takeover_is_on_purpose_and_leaves_a_trace(service: Served, mine: str) -> None:
    path, body = "/cell/lease/takeover", {"holder": "bert", "reason": "anna has gone home"}
    problem(service.client.post(path, json={"holder": "bert"}), 422)
    problem(service.client.post(path, json=body | {"reason": "  "}), 422)
    assert take(service, "anna", mine).status_code == 200
    taken = service.client.post(path, json=body).json()
    assert (taken["holder"], taken["taken_from"]) == ("bert", "anna")
    told = problem(take(service, "anna", mine), 409)
    assert "held by bert, who has taken it over from anna (anna has gone home)" in told["detail"]
    assert take(service, "bert", taken["lease_id"]).status_code == 200
    lines = [json.loads(line) for line in (record_of(service) / FILE).read_text("utf-8").splitlines()]
    last = lines[-1]
    assert (last["what"], last["holder"], last["before"], last["reason"]) == (
        "lease taken over",
        "bert",
        "anna",
        "anna has gone home",
    )
    assert last["utc"].endswith("Z")


def test_taking_over_from_nobody_is_taking(service: Served) -> None:
    taken = service.client.post(
        "/cell/lease/takeover", json={"holder": "bert", "reason": "sure is sure"}
    ).json()
    assert (taken["taken_from"], bool(taken["lease_id"])) == ("", True)
    service.client.delete("/cell/lease", headers={"Lease-Id": taken["lease_id"]})


# -- by itself ------------------------------------------------------------------------------------------------


def test_silence_frees_the_lease_for_another(tmp_path: Path) -> None:
    clock = LeaseClock()
    lease = MotionLease(Audit(tmp_path), clock)
    lapsed: list[str] = []
    first = lease.grant("anna", 30.0)
    with first.beats.watched(lambda: lapsed.append("anna")):
        clock.pass_by(29.0)
        assert lease.needed(first.secret) is first
        with pytest.raises(Problem, match="held by anna"):
            lease.grant("bert", 30.0)
        clock.pass_by(2.0)
        until(lambda: lapsed == ["anna"])
    with pytest.raises(Problem, match="No client holds"):
        lease.needed(first.secret)
    with pytest.raises(
        Problem, match="has ended"
    ):  # never granted anew: anna has to learn that the robot rests
        lease.renew("anna", 30.0, first.secret)
    second = lease.grant("bert", 60.0)
    assert second.secret != first.secret
    for secret in (first.secret, ""):
        with pytest.raises(Problem, match="held by bert"):
            lease.needed(secret)
    with pytest.raises(Problem, match="held by bert"):
        lease.renew("anna", 30.0, first.secret)
    assert lease.needed(second.secret) is second


def test_a_lease_that_is_prolonged_goes_on(tmp_path: Path) -> None:
    clock = LeaseClock()
    lease = MotionLease(Audit(tmp_path), clock)
    held = lease.grant("anna", 30.0)
    again = lease.renew("anna", 60.0, held.secret)
    assert again.secret == held.secret
    assert again.beats is held.beats  # what a run watches
    assert held.beats.left_s == 60.0
    assert again.expires_utc == clock.utc() + 60.0
    with pytest.raises(Problem, match="held by anna"):
        lease.renew("bert", 60.0, held.secret)  # a lease has one name


def test_a_calendar_that_jumps_ends_no_lease(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = LeaseClock()
    lease = MotionLease(Audit(tmp_path), clock)
    held = lease.grant("anna", 30.0)
    monkeypatch.setattr(clock, "utc", lambda: 9e9)
    assert lease.needed(held.secret) is held
    assert lease.renew("anna", 30.0, held.secret).expires_utc == 9e9 + 30.0


def test_the_secret_is_compared_in_constant_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[tuple[bytes, bytes]] = []
    real = hmac.compare_digest
    monkeypatch.setattr(hmac, "compare_digest", lambda a, b: compared.append((a, b)) or real(a, b))
    lease = MotionLease(Audit(tmp_path), LeaseClock())
    held = lease.grant("anna", 30.0)
    assert "secret" not in repr(held)
    for order in (
        lambda: lease.needed("x"),
        lambda: lease.renew("anna", 1.0, "x"),
        lambda: lease.give_back("x"),
    ):
        with pytest.raises(Problem):
            order()
    assert compared == [(b"x", held.secret.encode())] * 3


def test_what_cannot_be_noted_is_not_granted(tmp_path: Path) -> None:
    lease = MotionLease(Audit(tmp_path / "not there"), LeaseClock())
    for order in (lambda: lease.grant("anna", 30.0), lambda: lease.take_over("anna", 30.0, "why")):
        with pytest.raises(StorageError, match="cannot be written"):
            order()
    assert lease.current is None


def test_a_motion_that_begins_while_the_lease_changes_hands_is_paused(tmp_path: Path) -> None:
    """The takeover finds nothing to pause, and the run that begins does not see the takeover."""
    rested: list[str] = []

    async def main() -> None:
        service = Service(ServiceSettings(record=tmp_path / "record", tokens=Tokens("o", "v")))
        service.rest = lambda by, reason: rested.append(reason)
        try:
            held = service.lease.grant("anna", 30.0)

            def begin(_: acquisition.LeaseDeadline) -> str:
                service.lease.take_over("bert", 30.0, "in the same moment")
                return "run"

            assert service.let_move(held.secret, lambda _: "undisturbed") == "undisturbed"
            assert rested == []
            assert service.let_move(held.secret, begin) == "run"
        finally:
            service.close()

    anyio.run(main)
    assert rested == ["anna no longer holds the motion lease."]
