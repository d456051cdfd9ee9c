"""Test live values of a running service over MQTT and OPC UA, compared with HTTP.

These would catch: a value or an event that differs from that of HTTP or is missing, and a variable that a client can
write. They would also catch a connection without a token, and a cell that still seems present after its service was
killed.
"""

# asyncua exports by names that it does not list, and takes Python's types where its annotations have those of OPC UA.
# pyright: reportArgumentType=false, reportPrivateImportUsage=false

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID

from calib.errors import DataError
from service import exit_codes
from service.cli import main
from service.http.access.roles import Tokens
from service.http.live.opcua import NAMESPACE, NODES, OpcuaServer
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, cell_file
from tests.service.campaigns import write_data
from tests.service.live_broker import Collector, broker
from tests.service.test_http_support import lasting_port, served

TOKENS = Tokens("an-operator-of-the-tests", "a-viewer-of-the-tests")
CAMPAIGN = {
    "format": "truepose-campaign/1",
    "samples": 5,
    "settle_s": 0.0,
    "block": [{"set": "calibration", "select": "random", "count": 3}],
}
RUN = {
    "id": "r1", "name": "night", "state": "running", "state_code": 2, "reason": "", "done": 3, "total": 10,
    "skipped": 0, "seconds_left": 12.5, "simulated": True, "prompt": None,
    "last_reading": {"name": "p", "set": "calibration", "target": "T1", "t_air_c": 21.5, "world_mm": [1.0, 2.0, 3.0]},
}  # fmt: skip


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    port = lasting_port()
    with broker(port):
        yield port


@asynccontextmanager
async def session(address: str, user: str, password: str) -> AsyncIterator[Client]:
    client = Client(address)
    client.set_user(user)
    client.set_password(password)
    async with client:
        yield client


async def value(client: Client, name: str) -> ua.DataValue:
    space = await client.get_namespace_index(NAMESPACE)
    return await client.get_node(f"ns={space};s={name}").read_data_value(raise_on_bad_status=False)


def test_programs_see_what_http_answers_and_that_the_service_has_died(port: int, tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=60.0)
    more = ("--mqtt", f"mqtt://127.0.0.1:{port}", "--opcua", "0")
    with (
        Collector(port) as broker_says,
        served(tmp_path / "record", "--cell", str(cell), "--simulate", *more) as service,
    ):
        connections = {
            each["kind"]: each for each in service.client.get("/cell/connections").json()["connections"]
        }
        assert connections["opcua"]["state"] == "listening"
        place = f"truepose/{service.client.get('/cell').json()['name']}"
        run_id = service.begin(CAMPAIGN)
        prompts = set[str]()
        while (run := service.client.get(f"/runs/{run_id}").json())["state"] not in ("succeeded", "failed"):
            if run["prompt"] is not None and run["prompt"]["id"] not in prompts:
                prompts.add(run["prompt"]["id"])
                until(lambda run=run: broker_says.newest(f"{place}/prompt") == packed(run["prompt"]))
                service.client.post(f"/runs/{run_id}/prompts/{run['prompt']['id']}/confirm", json={})
            service.client.get(f"/runs/{run_id}", params={"wait": 1, "after": run["version"]})
        assert run["state"] == "succeeded", run
        until(lambda: state_of(broker_says, place) == "succeeded")
        body = service.client.get(f"/runs/{run_id}")
        assert json.loads(broker_says.newest(f"{place}/state") or b"") == body.json()
        assert broker_says.newest(f"{place}/reading") == packed(run["last_reading"])
        assert json.loads(broker_says.newest(f"{place}/progress") or b"")["done"] == run["total"]
        lines = service.client.get(f"/runs/{run_id}/events.jsonl").text.splitlines()
        until(lambda: len(events(broker_says, place)) >= len(lines), 60.0)
        assert [each["id"] for each in events(broker_says, place)] == [
            json.loads(line)["id"] for line in lines
        ]
        assert [each["kind"] for each in events(broker_says, place)] == [
            json.loads(line)["kind"] for line in lines
        ]

        data = write_data(tmp_path / "data", n=40)
        files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
        dataset = service.client.post("/datasets", files=files).json()["id"]
        job = service.client.post("/diagnoses", json={"dataset_id": dataset}).json()["id"]
        done = service.until(f"/diagnoses/{job}", "succeeded", "failed")
        until(lambda: json.loads(broker_says.newest(f"{place}/result") or b"null") is not None)
        assert json.loads(broker_says.newest(f"{place}/result") or b"") == done

        async def read() -> None:
            async with session(
                connections["opcua"]["address"], "viewer", service.hello["viewer_token"]
            ) as client:
                for name in ("state", "done", "total", "id"):
                    assert (await value(client, name)).Value.Value == run[name]  # type: ignore[union-attr]
                found = (
                    (await value(client, "result_id")).Value,
                    (await value(client, "result_verdict")).Value,
                )
                assert [each.Value for each in found if each] == [job, done["result"]["verdict"]]

        asyncio.run(read())
        service.process.kill()
        service.process.wait(PATIENCE_S)
        broker_says.wait(f"{place}/status", b"offline")


def packed(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()


def state_of(collector: Collector, place: str) -> str:
    return json.loads(collector.newest(f"{place}/state") or b'{"state": ""}')["state"]


def events(collector: Collector, place: str) -> list[dict[str, Any]]:
    return [
        json.loads(payload) for topic, payload, _ in list(collector.messages) if topic == f"{place}/event"
    ]


@pytest.fixture(scope="module")
def opcua(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpcuaServer]:
    with OpcuaServer("Zelle 1/ä", "127.0.0.1", 0, TOKENS, tmp_path_factory.mktemp("opcua")) as server:
        server.offer("state", json.dumps(RUN).encode(), retained=True)
        yield server


def test_the_example_prints_what_changes(opcua: OpcuaServer) -> None:
    command = [sys.executable, str(ROOT / "examples/live/read_opcua.py"), opcua.address, TOKENS.viewer]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        told = {next(process.stdout).strip() for _ in range(5)}
        process.kill()
    assert {"state running", "done 3", "total 10", "reading_world_mm [1.0, 2.0, 3.0]"} <= told


def test_variables_have_type_unit_time_and_description(opcua: OpcuaServer) -> None:
    async def read() -> None:
        async with session(opcua.address, "viewer", TOKENS.viewer) as client:
            space = await client.get_namespace_index(NAMESPACE)
            folder = client.get_node(f"ns={space};s=TruePose")
            assert (await folder.read_browse_name()).Name == "Zelle 1/ä"
            names = {(await each.read_browse_name()).Name for each in await folder.get_children()}
            assert names == {each.name for each in NODES}
            reading = await value(client, "reading_world_mm")
            assert reading.Value is not None
            assert (reading.Value.Value, reading.Value.VariantType) == (
                [1.0, 2.0, 3.0],
                ua.VariantType.Double,
            )
            assert reading.SourceTimestamp is not None
            assert (await value(client, "done")).Value == ua.Variant(3, ua.VariantType.Int32)
            assert (await value(client, "prompt_id")).StatusCode == ua.StatusCode(ua.StatusCodes.BadNoData)
            assert (await value(client, "result_id")).StatusCode == ua.StatusCode(ua.StatusCodes.BadNoData)
            for each in NODES:
                node = client.get_node(f"ns={space};s={each.name}")
                assert len((await node.read_description()).Text or "") > 4
                assert await node.read_data_type_as_variant_type() == each.kind
                units = [(await unit.read_value()).DisplayName.Text for unit in await node.get_properties()]
                assert units == ([each.unit] if each.unit else [])
                assert bool(each.unit) == each.name.endswith(("_mm", "_c", "seconds_left"))

    asyncio.run(read())


@pytest.mark.parametrize("user", ["viewer", "operator"])
def test_no_client_can_write_or_change_anything(opcua: OpcuaServer, user: str) -> None:
    async def write() -> None:
        async with session(opcua.address, user, getattr(TOKENS, user)) as client:
            space = await client.get_namespace_index(NAMESPACE)
            for each in NODES:
                node = client.get_node(f"ns={space};s={each.name}")
                before = await value(client, each.name)
                with pytest.raises(ua.UaStatusCodeError):
                    await node.write_value(ua.Variant("x", ua.VariantType.String))
                with pytest.raises(ua.UaStatusCodeError):
                    await node.write_attribute(
                        ua.AttributeIds.AccessLevel, ua.DataValue(ua.Variant(3, ua.VariantType.Byte))
                    )
                assert await value(client, each.name) == before
            with pytest.raises(ua.UaStatusCodeError):
                await client.nodes.objects.add_variable(space, "mine", 1)
            with pytest.raises(ua.UaStatusCodeError):
                await client.delete_nodes([client.get_node(f"ns={space};s=state")])

    asyncio.run(write())


@pytest.mark.parametrize(
    ("user", "password"),
    [
        ("viewer", TOKENS.operator),
        ("operator", TOKENS.viewer),
        ("viewer", ""),
        ("admin", "x"),
        ("", TOKENS.operator),
    ],
)
def test_a_client_without_a_token_is_refused(opcua: OpcuaServer, user: str, password: str) -> None:
    async def enter() -> None:
        async with session(opcua.address, user, password):
            pass

    with pytest.raises(ua.UaError):
        asyncio.run(enter())


def test_what_others_can_reach_is_encrypted_only(tmp_path: Path) -> None:
    async def enter(address: str) -> None:
        with pytest.raises(ua.UaError):
            async with session(address, "viewer", TOKENS.viewer):
                pass
        files = tmp_path / "client.pem", tmp_path / "client.der"
        usage, about = [ExtendedKeyUsageOID.CLIENT_AUTH], {"commonName": "client"}
        await setup_self_signed_certificate(*files, "urn:client", socket.gethostname(), usage, about)
        client = Client(address)
        client.application_uri = "urn:client"
        client.set_user("viewer")
        client.set_password(TOKENS.viewer)
        await client.set_security(SecurityPolicyBasic256Sha256, str(files[1]), str(files[0]))
        async with client:
            assert (await value(client, "done")).Value.Value == 3  # type: ignore[union-attr]
            modes = {each.SecurityMode for each in await client.get_endpoints()}
            assert modes == {ua.MessageSecurityMode.SignAndEncrypt}

    with OpcuaServer("cell", "0.0.0.0", 0, TOKENS, tmp_path / "opcua") as server:
        server.offer("state", json.dumps(RUN).encode(), retained=True)
        asyncio.run(enter(server.address.replace("0.0.0.0", "127.0.0.1")))


def test_a_port_in_use_is_refused_with_its_option(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(DataError, match=str(port)) as refused:
            OpcuaServer("cell", "127.0.0.1", port, TOKENS, tmp_path)
    assert refused.value.key == "--opcua"


def test_a_key_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "key.pem").write_text("mine", "utf-8")
    with pytest.raises(DataError) as refused, OpcuaServer("cell", "0.0.0.0", 0, TOKENS, tmp_path):
        pass
    assert refused.value.key == "--opcua"
    assert (tmp_path / "key.pem").read_text("utf-8") == "mine"


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--opcua", "0.0.0.0:0"), exit_codes.REFUSED, "without a token of your own"),
        (("--opcua", "nowhere"), exit_codes.USAGE, "--opcua"),
        (("--mqtt", "mqtt://broker.example"), exit_codes.USAGE, "no TLS"),
        (("--mqtt-ca", "ca.pem"), exit_codes.USAGE, "--mqtt"),
    ],
)
def test_the_command_refuses_what_is_not_safe(
    tmp_path: Path, options: tuple[str, ...], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--record", str(tmp_path / "record"), *options]) == code
    assert says in capsys.readouterr().err


def test_a_library_that_is_missing_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "paho", None)
    monkeypatch.delitem(sys.modules, "service.http.live.mqtt", raising=False)
    assert main(["serve", "--record", str(tmp_path / "record"), "--mqtt", "mqtt://127.0.0.1:1883"]) == 2
    assert 'pip install "truepose[mqtt]"' in capsys.readouterr().err
