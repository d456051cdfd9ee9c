"""`truepose fleet learn`, and `--prior` of `identify`, `diagnose` and `select`.

Output and refusals are tested.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import truepose
from acquisition import read_cell
from calib import identify, read_dataset, save_model
from mocks.campaign import make_campaign
from service.cli import main
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.results.cell.selected import SelectionResult
from service.results.models.identified import IdentificationResult
from service.results.typed import TypeStatisticsResult
from tests.benchmarks.priors import CELLS, a_type, learnt
from tests.calib.campaigns import write_files
from tests.service.test_openapi import unnamed

CELL = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
ROBOTS = 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write models 0.json .. of robots of a type, and readings data.csv of an unrelated robot."""
    folder = tmp_path_factory.mktemp("fleet")
    learnt(CELLS[1], a_type(1), 1, folder, ROBOTS)
    (folder / "prior.json").unlink()
    campaign = make_campaign("abb-irb120", 3, 60, 20, [])
    campaign.header["model"]["fit"] = ["base", "geometry", "parallel_twist", "compliance"]
    write_files(folder, campaign.rows, campaign.header)
    return folder


@pytest.fixture(scope="module")
def prior(folder: Path) -> Path:
    models = [str(folder / f"{i}.json") for i in range(ROBOTS)]
    assert main(["fleet", "learn", *models, "--out", str(folder / "p.json")]) == 0
    return folder / "p.json"


def test_what_is_learnt_is_written_and_said(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    models = [str(folder / f"{i}.json") for i in range(ROBOTS)]
    out, result = tmp_path / "p.json", tmp_path / "r.json"
    assert main(["fleet", "learn", *models, "--out", str(out), "--json", str(result)]) == 0
    document = json.loads(out.read_text("utf-8"))
    assert document == json.loads(result.read_text("utf-8"))
    assert unnamed(TypeStatisticsResult.model_validate(document)) == set()
    assert document["robots"] == ROBOTS
    assert [len(m["content_sha256"]) for m in document["models"]] == [64] * ROBOTS
    assert {
        "name",
        "unit",
        "mean",
        "mean_std",
        "spread",
        "spread_std",
        "robots",
        "of_next",
        "usual",
        "kept",
    } == {*document["parameters"][0]}
    shown = capsys.readouterr()
    assert "8 robots of the type abb-irb120" in shown.out
    assert "alpha2" in shown.out
    assert f"prior: {out}" in shown.err


def test_the_result_says_what_decided_every_parameter(
    folder: Path, prior: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The simulated arm lies outside the prior, and is fitted as if none existed."""
    result, model = tmp_path / "r.json", tmp_path / "m.json"
    arguments = ["identify", str(folder / "data.csv"), "--json", str(result), "--model", str(model)]
    assert main([*arguments, "--prior", str(prior)]) == 0
    said = json.loads(result.read_text("utf-8"))
    assert said["prior"]["robots"] == ROBOTS
    assert said["prior"]["content_sha256"] == json.loads(prior.read_text("utf-8"))["content_sha256"]
    assert said["prior"]["left_out"]
    assert said["prior"]["p_value"] < 0.001
    assert any("as a whole lies outside" in each for each in said["warnings"])
    shown = " ".join(capsys.readouterr().out.split())
    assert "lies outside its type" in shown
    alone = identify(read_dataset(folder / "data.csv"))
    by_python = truepose.identify(folder / "data.csv", prior=prior)
    assert by_python.fitted is not None
    assert by_python.fitted.beside is not None
    assert by_python.fitted.beside.left_out
    held = {p["name"]: p["value"] for p in said["parameters"] if p["value"] is not None}
    for p, value in zip(alone.model.parameters, alone.estimate, strict=True):
        if p.name in held and p.name[0] == "a":
            assert held[p.name] == pytest.approx(
                float(value) / alone.model.unit[alone.model.index[p.name]], abs=0.01
            )


def test_poses_are_fewer_beside_a_type(
    prior: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["select", str(CELL), "--out", str(tmp_path / "poses.csv"), "--from", "100", "--count", "20"]
    groups = ["--groups", "base,geometry,parallel_twist,compliance"]
    result = tmp_path / "r.json"
    assert main([*arguments, *groups, "--prior", str(prior), "--json", str(result)]) == 0
    said = json.loads(result.read_text("utf-8"))
    reached = said["prior"]["reached_with"]
    assert 8 < reached <= 20
    assert (
        said["prior"]["u_without_mm"]
        == said["uncertainty"]["max_u_mm"][said["uncertainty"]["poses"].index(20)]
    )
    assert "of 20 poses" in " ".join(capsys.readouterr().out.split()).replace("U of 20 poses", "of 20 poses")
    assert main([*arguments, "--groups", "base,geometry", "--prior", str(prior)]) == 2
    assert "Free the same groups" in capsys.readouterr().err


def test_over_http_a_type_says_the_same_as_at_the_terminal(folder: Path, prior: Path, tmp_path: Path) -> None:
    known = json.loads(prior.read_text("utf-8"))
    tokens = Tokens("only-for-the-tests-of-priors", "only-to-look-at-the-tests-of-priors")
    settings = ServiceSettings(record=tmp_path / "record", tokens=tokens, cell=read_cell(CELL))
    groups = ["base", "geometry", "parallel_twist", "compliance"]
    with TestClient(create_app(settings), base_url="http://127.0.0.1/api/v1") as client:
        client.headers |= {"Authorization": f"Bearer {tokens.operator}"}

        def result(path: str, **asked: Any) -> dict[str, Any]:
            answer = client.post(path, json=asked)
            assert answer.status_code == 202, answer.text
            where = answer.headers["location"].removeprefix("/api/v1")
            while (job := client.get(where, params={"wait": 30, "after": 2}).json())["state"] != "succeeded":
                assert job["state"] != "failed", job
            return job["result"]

        files = {name: (folder / f"data.{name}").read_bytes() for name in ("csv", "toml")}
        own = client.post("/datasets", files=files).json()["id"]
        found = result("/identifications", dataset_id=own, prior=known)
        poses = result("/selections", count=20, candidates=100, groups=groups, prior=known)
    data, out, chosen_out = str(folder / "data.csv"), tmp_path / "r.json", tmp_path / "s.json"
    assert main(["identify", data, "--prior", str(prior), "--json", str(out)]) == 0
    assert found["prior"] == json.loads(out.read_text("utf-8"))["prior"]
    chosen = ["select", str(CELL), "--out", str(tmp_path / "p.csv"), "--from", "100", "--count", "20"]
    assert (
        main([*chosen, "--groups", ",".join(groups), "--prior", str(prior), "--json", str(chosen_out)]) == 0
    )
    assert poses == json.loads(chosen_out.read_text("utf-8"))
    assert unnamed(IdentificationResult.model_validate(found)) == set()
    assert unnamed(SelectionResult.model_validate(poses)) == set()


def test_what_cannot_be_learnt_from_or_used_is_refused(
    folder: Path, prior: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    models = [str(folder / f"{i}.json") for i in range(ROBOTS)]
    out = ["--out", str(tmp_path / "p.json")]
    for arguments, said in (
        (["fleet", "learn", *models[:3], *out], "too few models to learn from: 3"),
        (["fleet", "learn", *models, models[0], *out], "count twice"),
        (["fleet", "learn", str(prior), *out], "is not a model file"),
        (["fleet", "learn", *models, "--out", models[0]], "which is read"),
        (["identify", str(folder / "data.csv"), "--prior", models[0]], "is not the prior of a type"),
        (["identify", str(folder / "data.csv"), "--prior", str(tmp_path / "none.json")], "none.json"),
        (
            ["identify", str(folder / "data.csv"), "--level", "2", "--prior", str(prior)],
            "Free the same groups",
        ),
        (
            ["diagnose", str(folder / "data.csv"), "--prior", str(prior), "--model", str(prior)],
            "which is read",
        ),
    ):
        assert main(arguments) == 2, arguments
        assert said in capsys.readouterr().err
    assert not (tmp_path / "p.json").exists()


def test_a_prior_of_another_robot_is_refused(
    folder: Path, prior: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    campaign = make_campaign("ur10", 3, 60, 20, [], tool_mass_kg=2.7, tool_cog_mm=(50.0, 25.0, 100.0))
    data = write_files(tmp_path, campaign.rows, campaign.header)
    assert main(["identify", str(data), "--prior", str(prior)]) == 2
    assert "of the type 'abb-irb120', these readings are of 'ur10'" in capsys.readouterr().err


def test_an_older_model_is_refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_model(tmp_path / "m.json", identify(read_dataset(folder / "data.csv")))
    document = json.loads((tmp_path / "m.json").read_text("utf-8"))
    del document["content_sha256"]
    document["simulated"] = False  # as the other models say
    for parameter in document["parameters"]:
        del parameter["held_std"]
    (tmp_path / "m.json").write_text(json.dumps(document), "utf-8")
    models = [str(folder / f"{i}.json") for i in range(ROBOTS)]
    assert main(["fleet", "learn", *models, str(tmp_path / "m.json"), "--out", str(tmp_path / "p.json")]) == 2
    assert "an older version wrote it" in capsys.readouterr().err
