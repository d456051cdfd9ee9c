"""`truepose fleet send`, `outbox` and `serve` as a person uses them.

The files of examples/fleet are tested too. These would catch: an exit code that hides documents that were not sent, a
sender that does not end, and an example with an option that no longer exists.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet.outbox import FILE, Outbox
from fleet.store import FleetStore
from service.cli import main
from service.commands import load
from tests.drivers.nobody import nobody_listens
from tests.drivers.waiting import until
from tests.fleet.test_folder import MODEL, write
from tests.fleet.test_outbox_to_store import TOKENS, server_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "fleet"


@pytest.fixture
def tokens(tmp_path: Path) -> Path:
    file = tmp_path / "tokens"
    file.write_text(f"{TOKENS.operator}\n", encoding="utf-8")
    file.chmod(0o600)
    return file


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path / "records" / "model.json", MODEL)
    return tmp_path / "records"


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    with server_of(f"sqlite:///{tmp_path}/plant.sqlite3") as port:
        yield f"http://127.0.0.1:{port}"


def send(folder: Path, url: str, tokens: Path, *more: str) -> int:
    return main(["fleet", "send", str(folder), "--to", url, "--token-file", str(tokens), *more])


def test_a_model_gets_there_and_nothing_is_sent_twice(
    folder: Path, url: str, tokens: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert send(folder, url, tokens, "--cell", "hall 3", "--json", str(tmp_path / "sent.json")) == 0
    assert json.loads((tmp_path / "sent.json").read_text("utf-8"))["sent"] == 1
    assert "1 document sent." in capsys.readouterr().out
    assert send(folder, url, tokens) == 0
    assert "0 documents sent." in capsys.readouterr().out
    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        (entry,) = store.documents()
        assert entry.cell == "hall 3"
        assert store.content(entry.hash) == (folder / "model.json").read_bytes()
    assert main(["fleet", "outbox", "list", str(folder)]) == 0
    assert "1 sent, 0 wait, 0 set aside" in capsys.readouterr().out


def test_without_a_server_it_waits_and_with_a_wrong_token_too(
    folder: Path, url: str, tokens: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with nobody_listens() as port:
        assert send(folder, f"http://127.0.0.1:{port}", tokens) == 4
    assert "does not answer" in capsys.readouterr().out
    tokens.write_text("a-token-that-nobody-knows\n", encoding="utf-8")
    assert send(folder, url, tokens) == 2
    assert "token is missing or wrong" in capsys.readouterr().out
    tokens.write_text(f"{TOKENS.operator}\n", encoding="utf-8")
    assert send(folder, url, tokens) == 0


def test_a_refused_document_is_told_listed_and_sent_again_when_asked(
    folder: Path, url: str, tokens: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(folder / "watch.json", MODEL | {"format": "truepose-watch/1"})  # says no verdict
    assert send(folder, url, tokens) == 1
    out = capsys.readouterr().out
    assert "1 document sent, 1 set aside" in out
    assert main(["fleet", "outbox", "list", str(folder), "--json", "-"]) == 0
    (aside,) = json.loads(capsys.readouterr().out)["set_aside"]
    assert "verdict" in aside["reason"]
    assert send(folder, url, tokens) == 0  # nothing new, and it is not asked again by itself
    assert main(["fleet", "outbox", "retry", str(folder), "ffff"]) == 2
    assert main(["fleet", "outbox", "retry", str(folder), aside["hash"][:6]]) == 0
    assert send(folder, url, tokens) == 1


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (
            ["fleet", "send", "{}/nowhere", "--to", "http://a:1", "--token-file", "{}/tokens"],
            "no such folder",
        ),
        (["fleet", "send", "{}/records", "--to", "a:1", "--token-file", "{}/tokens"], "--to"),
        (["fleet", "send", "{}/records", "--to", "http://a:1", "--token-file", "{}/none"], "none"),
        (["fleet", "outbox", "list", "{}/records"], "no outbox"),
        (["fleet", "serve", "--store", "mysql://a/b", "--token-file", "{}/tokens"], "mysql"),
        (
            ["fleet", "serve", "--store", "sqlite:///{}/p", "--token-file", "{}/tokens", "--name", "a b"],
            "a b",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused(
    folder: Path, tokens: Path, arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [each.replace("{}", str(folder.parent)) for each in arguments]
    assert main(given) in (1, 2)
    assert word in capsys.readouterr().err


def test_a_token_that_others_can_read_is_refused(
    folder: Path, tokens: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tokens.chmod(0o644)
    assert send(folder, "http://127.0.0.1:1", tokens) == 2
    assert "chmod 600" in capsys.readouterr().err


def test_a_sender_that_goes_on_sends_what_comes_and_ends_when_it_is_asked_to(
    folder: Path, url: str, tokens: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "truepose", "fleet", "send", str(folder), "--to", url, "--every", "0.1"]
    with subprocess.Popen([*command, "--token-file", str(tokens)], stderr=subprocess.PIPE) as process:

        def sent() -> int:
            if not (folder / FILE).is_file():
                return 0
            with Outbox(folder / FILE) as outbox:
                return len(outbox.entries("sent"))

        until(lambda: sent() == 1)
        assert send(folder, url, tokens) == 2  # one at a time
        write(folder / "later" / "model.json", MODEL | {"parameters": [], "note": "another"})
        until(lambda: sent() == 2)
        process.send_signal(signal.SIGTERM)
        _, told = process.communicate()
    assert process.returncode == 0, told


def services() -> dict[str, dict[str, Any]]:
    text = (EXAMPLE / "compose.yaml").read_text("utf-8")
    return yaml.safe_load(text)["services"]


def test_the_program_takes_every_command_of_the_compose_file() -> None:
    seen = set()
    for name, service in services().items():
        words = service.get("command", [])
        if service.get("entrypoint", [""])[0] == "dask":
            from distributed.cli import dask_scheduler, dask_worker

            command = {"scheduler": dask_scheduler, "worker": dask_worker}[words[0]].main
            command.make_context(words[0], list(words[1:]))
            seen.add(words[0])
        elif words:
            store = ["postgresql://u@db/plant"] if words == ["fleet", "migrate"] else []
            load("fleet").commands[words[1]].make_context(words[1], [*words[2:], *store, *_missing(words)])
            seen.add(words[1])
        else:
            assert name == "db" or service["entrypoint"][1] == "/example/cell.sh"
    assert seen == {"migrate", "serve", "diagnose", "scheduler", "worker"}


def _missing(words: list[str]) -> list[str]:
    """The store, which the compose file gives in the environment."""
    return ["--store", "postgresql://u@db/plant"] if words[1] in ("serve", "diagnose") else []


def test_only_this_computer_reaches_what_the_compose_file_publishes() -> None:
    published = [port for service in services().values() for port in service.get("ports", [])]
    assert published
    assert all(port.startswith("127.0.0.1:") for port in published)
    assert "ports" not in services()["scheduler"]
    assert services()["scheduler"]["networks"] == services()["worker"]["networks"] == ["inside"]


_NOTES = """#!/bin/sh
echo "$*" >>{calls}
case "$1 $2" in
"fleet send") exec sleep 600 ;;
"watch run") exit 3 ;;
esac
"""


@pytest.mark.skipif(os.name != "posix", reason="a shell script")
def test_the_script_of_a_cell_measures_sends_and_ends(tmp_path: Path) -> None:
    """The `truepose` of this test only records its calls."""
    calls, program = tmp_path / "calls", tmp_path / "bin" / "truepose"
    program.parent.mkdir()
    program.write_text(_NOTES.format(calls=calls), encoding="utf-8")
    program.chmod(0o755)
    data = tmp_path / "data"
    data.mkdir()
    own = {
        "NUMBER": "2",
        "TO": "http://f:1",
        "TOKENS": "/t",
        "EXAMPLE": str(EXAMPLE),
        "DATA": str(data),
        "EVERY": "600",
    }
    path = f"{program.parent}:{os.environ['PATH']}"
    with subprocess.Popen(
        ["/bin/sh", str(EXAMPLE / "cell.sh")], env=os.environ | own | {"PATH": path}
    ) as process:
        until(lambda: calls.exists() and "watch run" in calls.read_text("utf-8"))
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    said = calls.read_text("utf-8").splitlines()
    order = [
        re.sub(r"-\d{9,}", "-N", " ".join(line.split()[:2])) for line in said if "fleet send" not in line
    ]
    assert order == [
        "campaign run",
        "campaign export",
        "diagnose campaign-N/data.csv",
        "watch plan",
        "watch run",
    ]
    assert 'serial = "120-500002"' in (data / "cell.toml").read_text("utf-8")
    assert "seed = 2" in (data / "cell.toml").read_text("utf-8")
