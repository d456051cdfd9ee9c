"""Two tokens, and the files where they are kept.

A viewer may stop the robot, but change nothing. These would catch: a viewer who moves a robot or takes its lease, one
who cannot stop it, and a route added later that is open to viewers by oversight. They would also catch a file of
tokens that others can read or that outlives its service, and a token in a file that others could read already.
"""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from calib.errors import DataError
from service.cli import main
from service.http.access.roles import Role, Tokens, viewer_may
from service.private import lasting_tokens, make_secret, owner_only, tokens_until_the_end
from tests.changing_files import looked_at
from tests.drivers.waiting import PATIENCE_S
from tests.service.test_http import CAMPAIGN, CELL
from tests.service.test_http_support import TOKEN, Served, problem, served

VIEWER = "who-only-looks-on-at-the-tests"
on_posix = pytest.mark.skipif(os.name != "posix", reason="modes are those of POSIX")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("roles")
    make_secret(folder / "tokens", f"{TOKEN}\n{VIEWER}\n")
    with served(folder / "record", "--cell", str(CELL), "--token-file", str(folder / "tokens")) as running:
        yield running


@pytest.fixture
def viewer(service: Served) -> Iterator[httpx2.Client]:
    with httpx2.Client(
        base_url=service.client.base_url, headers={"Authorization": f"Bearer {VIEWER}"}, timeout=PATIENCE_S
    ) as client:
        yield client


def operations(service: Served) -> list[tuple[str, str, dict[str, Any]]]:
    paths = service.anybody.get("/openapi.json").json()["paths"]
    return [(method.upper(), path, told) for path, item in paths.items() for method, told in item.items()]


def test_a_viewer_reads_pauses_and_stops(service: Served, viewer: httpx2.Client) -> None:
    open_to_it = set()
    for method, path, told in operations(service):
        answer = viewer.request(method, service.url + path.replace("{", "").replace("}", ""), json={})
        if answer.status_code == 403:
            refused = problem(answer, 403)
            assert refused["code"] == 8113
            assert "operator's token" in refused["what_to_do"]
            assert "security" not in told  # that of the whole document: the operator's
        else:
            open_to_it.add(told["operationId"])
            assert told["security"] in ([], [{"operator": []}, {"viewer": []}])
    orders = {told["operationId"] for method, _, told in operations(service) if method != "GET"}
    at_rest = {f"{verb}{what}" for verb in ("pause", "stop") for what in ("Run", "Loop", "Verification")}
    assert open_to_it & orders == at_rest
    assert len(open_to_it) > 15
    assert service.client.get("/campaigns").json() == {"campaigns": []}


def test_each_token_is_told_its_role(service: Served, viewer: httpx2.Client) -> None:
    assert service.hello["viewer_token"] == VIEWER
    assert viewer.get("/cell").json()["role"] == "viewer"
    assert service.client.get("/cell").json()["role"] == "operator"
    order = {"campaign": CAMPAIGN}
    problem(viewer.post("/runs", json=order), 403)  # not even a dry run: it is kept
    run = service.client.post("/runs", json=order).json()["id"]
    assert viewer.get(f"/runs/{run}").json()["state"] == "succeeded"
    problem(viewer.post(f"/runs/{run}/stop"), 409)  # heard; there is nothing to stop


def test_what_a_viewer_may_is_listed_and_nothing_else() -> None:
    assert viewer_may("GET", "/api/v1/anything")
    assert viewer_may("POST", "/api/v1/loops/a/stop")
    for path in (
        "/api/v1/runs",
        "/api/v1/runs/a/resume",
        "/api/v1/runs/stop",
        "/api/v1/runs/a/b/stop",
        "/stop",
    ):
        assert not viewer_may("POST", path)
    for method in ("DELETE", "PUT", "PATCH", "OPTIONS", "get"):
        assert not viewer_may(method, "/api/v1/runs/a/stop")
    tokens = Tokens("operator", "viewer")
    assert [tokens.role_of(t) for t in ("operator", "viewer", "", "oper")] == [
        Role.OPERATOR,
        Role.VIEWER,
        None,
        None,
    ]
    assert "operator" not in repr(tokens)


# -- the file -------------------------------------------------------------------------------------------------


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@on_posix
def test_the_file_of_a_start_is_the_owners_and_goes_with_the_service(tmp_path: Path) -> None:
    before = os.umask(0)  # no help from there
    try:
        file = tmp_path / "record" / "tokens"
        file.parent.mkdir()
        file.write_text("of-a-service\nthat-was-killed\n", "utf-8")
        with tokens_until_the_end(file.parent, None) as first:
            assert mode_of(file) == 0o600
            assert file.read_text("utf-8") == f"{first.operator}\n{first.viewer}\n"
            assert first.operator != first.viewer
        assert not file.exists()
        with tokens_until_the_end(file.parent, TOKEN) as second:
            assert (second.operator, second.viewer == first.viewer) == (TOKEN, False)
            file.write_text("of a service begun since\n", "utf-8")
        assert file.exists()
    finally:
        os.umask(before)


@on_posix
def test_a_lasting_file_is_made_once_and_read_ever_after(tmp_path: Path) -> None:
    file = tmp_path / "mine"
    made = lasting_tokens(file)
    assert mode_of(file) == 0o600
    assert lasting_tokens(file) == made
    make_secret(tmp_path / "one", f"{TOKEN}\n")
    assert lasting_tokens(tmp_path / "one").operator == TOKEN
    for name, text, what in (
        ("three", f"{TOKEN}\n{VIEWER}\n{VIEWER}x\n", "more than two lines"),
        ("same", f"{TOKEN}\n{TOKEN}\n", "the same token"),
        ("none", "\n", "not a usable token"),
        ("bytes", "", "not a usable token"),
        ("short", f"{TOKEN[:15]}\n", "not a usable token"),
        ("short viewer", f"{TOKEN}\n{VIEWER[:15]}\n", "not a usable token"),
    ):
        make_secret(tmp_path / name, text)
        with pytest.raises(DataError, match=what):
            lasting_tokens(tmp_path / name)
    (tmp_path / "bytes").write_bytes(b"\xff" * 20)
    with pytest.raises(DataError, match="not UTF-8"):
        lasting_tokens(tmp_path / "bytes")


@on_posix
def test_a_name_that_is_no_file_of_tokens_is_refused_and_never_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")  # nobody writes to it
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "nowhere").symlink_to(tmp_path / "gone")
    for name, what in (
        ("pipe", "not an ordinary file"),
        (".", "is a folder"),
        ("loop", "cannot be read"),
        ("nowhere", "no such file"),
    ):
        with pytest.raises(DataError, match=what):
            lasting_tokens(tmp_path / name)


@on_posix
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_file_that_others_can_read_is_refused(
    mode: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "tokens"
    make_secret(file, f"{TOKEN}\n")
    file.chmod(mode)
    with socket.create_server(
        ("127.0.0.1", 0)
    ) as taken:  # were the file accepted, the service could not start
        port = str(taken.getsockname()[1])
        order = ["serve", "--token-file", str(file), "--record", str(tmp_path / "record"), "--port", port]
        assert main(order) == 2
    told = capsys.readouterr().err
    assert "can be read by others" in told
    assert f"chmod 600 {file}" in told
    assert not (tmp_path / "record").exists()


@on_posix
def test_serve_prints_where_its_tokens_are(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        with served(tmp_path / "record") as running:
            file = Path(running.hello["token_file"])
            assert file == tmp_path / "record" / "tokens"
            assert file.read_text("utf-8") == f"{TOKEN}\n{running.hello['viewer_token']}\n"
            assert running.client.post("/campaigns", json={"campaign": CAMPAIGN}).status_code == 201
            modes = looked_at(file.parent, lambda path: (path.is_dir(), mode_of(path)))
            assert set(modes.values()) == {(False, 0o600), (True, 0o700)}
            running.process.terminate()
            assert running.process.wait(PATIENCE_S) == 0
        assert not file.exists()
    finally:
        os.umask(before)


@on_posix
def test_a_campaign_at_the_desk_keeps_its_record_to_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its devices are not there: the record is made, and the campaign pauses."""
    text = (
        CELL.read_text("utf-8")
        .replace("192.168.125.1:5000", "127.0.0.1:9")
        .replace("127.0.0.1:5701", "127.0.0.1:9")
    )
    (tmp_path / "cell.toml").write_text(text, "utf-8")
    block = '[[block]]\nset = "calibration"\ncount = 2\nselect = "random"\n'
    (tmp_path / "campaign.toml").write_text(f'format = "truepose-campaign/1"\n{block}', "utf-8")
    record, json = tmp_path / "record", tmp_path / "status.json"
    before = os.umask(0o022)
    try:
        files = [str(tmp_path / "cell.toml"), str(tmp_path / "campaign.toml")]
        assert main(["campaign", "run", *files, "--record", str(record), "--json", str(json)]) == 4
        assert mode_of(record) == 0o700
        assert {path.name: mode_of(path) for path in record.iterdir()} == {
            path.name: 0o600 for path in record.iterdir()
        }
        assert (record / "record.sqlite3").is_file()
        assert mode_of(json) == 0o600
        assert os.umask(0o022) == 0o022  # of the process that called: as it was
        capsys.readouterr()
        record.chmod(0o755)
        main(["campaign", "resume", str(record)])
        assert f"chmod -R go= {record}" in capsys.readouterr().err
        assert mode_of(record) == 0o755  # somebody may have wanted it so
    finally:
        os.umask(before)


@on_posix
def test_the_umask_comes_back_after_a_failure() -> None:
    before = os.umask(0o022)
    try:
        with pytest.raises(ZeroDivisionError), owner_only():
            _ = 1 // 0
        assert os.umask(0o022) == 0o022
    finally:
        os.umask(before)
