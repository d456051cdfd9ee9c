"""The pages for a cell PC, run as a person would who copies them, and the client for Python.

These would catch: a page whose requests the service does not know, and a campaign that does not reach its end with such
a page. They would also catch a lease that lapses in spite of its heartbeat, an order that waits for the network, and
a request that is sent twice and done twice.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from service.client import Client, ServiceError
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from tests.drivers.nobody import nobody_listens
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, cell_file
from tests.service.campaigns import write_data
from tests.service.test_http_support import TOKEN, Served, served

PAGES = ROOT / "docs" / "cell-pc"
CAMPAIGN = """format = "truepose-campaign/1"
samples = 20
settle_s = 0.0
[[block]]
set = "calibration"
select = "random"
count = 8
[[block]]
set = "validation"
select = "random"
count = 2
"""
node = shutil.which("node")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("cell-pc")
    cell = cell_file(folder, time_scale=60.0)
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


def taken_from(page: str, folder: Path, text: str = "") -> Path:
    """The program of a page, of examples/cell-pc or of `text`, in a folder with a campaign as TOML and as JSON."""
    if text:
        name = page
    elif page.endswith(".md"):
        (name, text), *_ = re.findall(
            r"```\w+ file=(\S+)\n(.*?)```", (PAGES / page).read_text("utf-8"), re.DOTALL
        )
    else:
        name, text = page, (ROOT / "examples" / "cell-pc" / page).read_text("utf-8")
    (folder / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    (folder / "campaign.json").write_text(json.dumps(tomllib.loads(CAMPAIGN)), "utf-8")
    (folder / name).write_text(text, "utf-8")
    return folder / name


def run(command: list[str | Path], folder: Path, service: Served) -> str:
    names = {"TRUEPOSE_URL": service.url, "TRUEPOSE_TOKEN": TOKEN, "URL": service.url, "TOKEN": TOKEN}
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | names | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, (done.stdout, done.stderr)
    return done.stdout


def test_the_python_page_runs_a_campaign(service: Served, tmp_path: Path) -> None:
    program = taken_from("python.md", tmp_path)
    told = run([sys.executable, program, "campaign.toml"], tmp_path, service)
    assert "checked: Checked only: 13 visits, 30 readings; nothing has moved." in told
    assert "succeeded: 30 of 30" in told
    assert re.search(r"0\.\d{3} mm, (not )?accepted", told)
    assert (tmp_path / "report.html").read_text("utf-8").lower().startswith("<!doctype html>")
    assert service.client.get("/cell").json()["lease"] is None


@pytest.mark.skipif(not (shutil.which("curl") and shutil.which("sh")), reason="needs a shell and curl")
def test_the_curl_page_runs_a_campaign(service: Served, tmp_path: Path) -> None:
    told = run(["sh", taken_from("curl.md", tmp_path), "campaign.toml"], tmp_path, service)
    assert "succeeded: 30 of 30" in told
    assert re.search(r"(?m)^\w+, (accepted|rejected|not_decided)$", told)
    assert service.client.get("/cell").json()["lease"] is None


@pytest.mark.skipif(not (shutil.which("curl") and shutil.which("sh")), reason="needs a shell and curl")
def test_the_page_of_the_core_has_a_working_example_of_each_of_its_operations(
    service: Served, tmp_path: Path
) -> None:
    page = (PAGES / "core.md").read_text("utf-8")
    taken_from("core.sh", tmp_path, "".join(re.findall(r"```sh\n(.*?)```", page, re.DOTALL)))
    write_data(tmp_path, n=60)
    told = run(["sh", tmp_path / "core.sh"], tmp_path, service)
    assert re.fullmatch(r"30\nattributed\nChecked only: .*\n", told)
    assert (tmp_path / "report.html").read_text("utf-8").lower().startswith("<!doctype html>")
    assert service.client.get("/cell").json()["lease"] is None
    paths = service.anybody.get("/openapi.json").json()["paths"]
    core = {
        each["operationId"] for item in paths.values() for each in item.values() if "Core" in each["tags"]
    }
    assert set(re.findall(r"`([a-z]+[A-Z]\w+)`", page)) == core


@pytest.mark.skipif(node is None, reason="needs node")
def test_the_flow_runs_a_campaign(service: Served, tmp_path: Path) -> None:
    assert node is not None
    flow = taken_from("flow.json", tmp_path)
    told = run([node, ROOT / "tests" / "service" / "node_red.js", flow, "campaign.json"], tmp_path, service)
    assert json.loads(told.splitlines()[-1].removeprefix("result: ")).keys() == {"verdict", "accepted"}
    until(lambda: service.client.get("/cell").json()["lease"] is None)


@pytest.mark.skipif(node is None, reason="needs node")
@pytest.mark.parametrize(("status", "problems"), [(202, 0), (202, 1), (401, 0), ("ECONNREFUSED", 0)])
def test_the_flow_says_where_the_robot_did_not_hear_a_stop(
    tmp_path: Path, status: int | str, problems: int
) -> None:
    assert node is not None
    nodes = json.loads(taken_from("flow.json", tmp_path).read_text("utf-8"))
    (heard,) = [each["func"] for each in nodes if each["id"] == "halt_c"]
    message = {"statusCode": status, "payload": {"problems": [{"message": "not reachable"}] * problems}}
    script = f"const node = {{ error: console.log }}; (msg => {{ {heard} }})({json.dumps(message)});"
    told = subprocess.run(
        [node, "-e", script], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert ("NOT stopped" in told.stdout) == ((status, problems) != (202, 0))


ASSEMBLIES = ("System.Net.Http", "System.Runtime.Serialization", "System.Xml", "System.Xml.Linq")
PROJECT = (
    '<Project Sdk="Microsoft.NET.Sdk"><PropertyGroup><OutputType>Exe</OutputType><LangVersion>5</LangVersion>'
    "<ImplicitUsings>disable</ImplicitUsings><TargetFramework>net8.0</TargetFramework></PropertyGroup></Project>"
)


def compiled(program: Path) -> list[str | Path]:
    """Return the command that runs a program in C# 5 with Mono or .NET.

    Skip the test if neither is installed with all that the program needs.
    """
    folder, mcs, mono, dotnet = program.parent, *(shutil.which(name) for name in ("mcs", "mono", "dotnet"))
    if mcs and mono:
        given = ["-langversion:5", "-warnaserror", f"-out:{folder / 'page.exe'}"]
        given += [f"-r:{name}" for name in ASSEMBLIES]
        told = subprocess.run([mcs, *given, program], capture_output=True, text=True, timeout=PATIENCE_S)
        missing = re.search(r"CS0006: Metadata file `([^']+)' could not be found", told.stdout + told.stderr)
        if missing and missing[1].removesuffix(".dll") in ASSEMBLIES:
            pytest.skip(f"this Mono has no {missing[1]}")
        assert told.returncode == 0, (told.stdout, told.stderr)
        return [mono, folder / "page.exe"]
    if not dotnet:
        pytest.skip("there is no C# compiler: neither mcs and mono nor dotnet")
    (folder / "Page.csproj").write_text(PROJECT, "utf-8")
    return [dotnet, "run", "--"]


def test_the_csharp_program_runs_a_campaign(service: Served, tmp_path: Path) -> None:
    program = taken_from("Program.cs", tmp_path)
    told = run([*compiled(program), "campaign.json"], tmp_path, service)
    assert "succeeded: 30 of 30" in told
    assert re.search(r"(?m)^\w+, (accepted|rejected|not_decided)$", told)
    assert (tmp_path / "report.html").read_text("utf-8").lower().startswith("<!doctype html>")
    assert service.client.get("/cell").json()["lease"] is None


def test_every_request_of_the_pages_is_one_that_the_service_knows(tmp_path: Path) -> None:
    paths = create_app(ServiceSettings(tmp_path, Tokens("o", "v"))).openapi()["paths"]
    asked = 0
    for page in PAGES.glob("*.md"):
        for method, path in re.findall(r"`?(GET|POST|DELETE) (/api/v1/[^\s`?]+)", page.read_text("utf-8")):
            assert method.lower() in paths.get(path, {}), (page.name, method, path)
            asked += 1
    assert asked > 15


def test_the_lease_is_prolonged_as_long_as_it_is_held(service: Served) -> None:
    with Client(service.url, TOKEN) as cell:
        with cell.lease("anna", seconds=120.0, every_s=0.05) as lease:
            first = cell.ask("GET", "/cell")["lease"]["expires_utc"]
            until(lambda: cell.ask("GET", "/cell")["lease"]["expires_utc"] > first)
            assert not lease.lost.is_set()
            with pytest.raises(ServiceError, match="held by anna") as refused, cell.lease("bert"):
                pass
            assert refused.value.code == 8102
            assert "take it over" in refused.value.what_to_do
            taken = cell.ask("POST", "/cell/lease/takeover", {"holder": "carl", "reason": "now me"})
            assert lease.lost.wait(PATIENCE_S)
        assert cell.ask("GET", "/cell")["lease"]["holder"] == "carl"  # what was lost is not given back
        cell.ask("DELETE", "/cell/lease", headers={"Lease-Id": taken["lease_id"]})


def test_what_is_asked_again_with_its_key_is_done_once(service: Served) -> None:
    with Client(service.url, TOKEN) as cell:
        campaign = {"campaign": tomllib.loads(CAMPAIGN), "name": "twice"}
        ids = {cell.once("/campaigns", campaign, "the-same")["id"] for _ in range(3)}
        assert len(ids) == 1


def test_the_client_reads_a_list_page_by_page(service: Served) -> None:
    with Client(service.url, TOKEN) as cell:
        made = [cell.once("/campaigns", {"campaign": tomllib.loads(CAMPAIGN)})["id"] for _ in range(5)]
        assert [each["id"] for each in cell.each("campaigns", limit=2)][:5] == made[::-1]
        assert [*cell.each("watch-plans")] == []
        with pytest.raises(ServiceError, match="limit") as refused:
            next(cell.each("runs", limit=501))
        assert refused.value.status == 422


def test_a_stop_returns_before_it_is_heard() -> None:
    """A stop returns even if the service takes the connection and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        cell = Client(f"http://127.0.0.1:{silent.getsockname()[1]}", TOKEN, timeout_s=PATIENCE_S)
        heard = cell.stop("x")
        assert not heard.done()
        link, _ = silent.accept()
        with link:
            assert link.recv(1000).startswith(b"POST /api/v1/runs/x/stop ")
            assert not heard.done()
        with pytest.raises(ConnectionError):
            heard.result(PATIENCE_S)


def test_a_stop_that_reaches_nobody_says_so() -> None:
    with nobody_listens() as port, pytest.raises(ConnectionError):
        Client(f"http://127.0.0.1:{port}", TOKEN).stop("x").result(PATIENCE_S)


@pytest.mark.parametrize("url", ["", "127.0.0.1:80", "https://127.0.0.1:1", "http://127.0.0.1"])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="http://ADDRESS:PORT"):
        Client(url, TOKEN)


def test_the_client_stands_alone(tmp_path: Path) -> None:
    """Copied by itself, it imports nothing but the standard library."""
    shutil.copy(ROOT / "service" / "client.py", tmp_path / "client.py")
    code = "import sys, client; print(sorted({n.split('.')[0] for n in sys.modules} - set(sys.stdlib_module_names)))"
    done: Any = subprocess.run(
        [sys.executable, "-I", "-S", "-c", f"import sys; sys.path.insert(0, '.'); {code}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE_S,
    )
    assert done.stdout.strip() == "['__main__', 'client']"
