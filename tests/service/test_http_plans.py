"""Plans, scenes, prices, and poses again or left out, by HTTP.

These would catch: a picture of another cell, a dry run without its path, and a pose that moves the robot without the
lease. They would also catch a pose that is measured again and lost, and a price that says leaving poses out makes
predictions better. A campaign file with a path or a wrong key must be refused with the place of the fault.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.cell import read_cell, targets_at
from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.test_http_support import Served, problem, served


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = cell_file(tmp_path_factory.mktemp("plans"), time_scale=40.0)
    boxed = file.read_text("utf-8").replace("keep_out = []", "keep_out = [[[250, 350, 20], [450, 500, 220]]]")
    file.write_text(boxed, "utf-8")
    return file


@pytest.fixture(scope="module")
def service(cell: Path) -> Iterator[Served]:
    with served(cell.parent / "record", "--cell", str(cell), "--simulate") as running:
        yield running


def uploaded(service: Served, folder: Path, **changes: Any) -> str:
    file = campaign_file(folder, **({"warm_up_s": 0.0, "settle_s": 2.0} | changes))
    answer = service.client.post("/campaigns/file", files={"toml": file.read_bytes()}, data={"name": "night"})
    assert answer.status_code == 201, answer.text
    assert answer.json()["name"] == "night"
    return answer.json()["id"]


def test_a_campaign_file_is_kept_or_refused_by_its_key(service: Served, tmp_path: Path) -> None:
    uploaded(service, tmp_path)
    for text, said in (
        (b"seed = = 1", "campaign.toml"),
        (b'format = "other"', "format"),
        (b"\xff\xfe", "UTF-8"),
    ):
        assert said in problem(service.client.post("/campaigns/file", files={"toml": text}), 422)["detail"]
    evil = (
        b'format = "truepose-campaign/1"\n[[block]]\nkind = "poses"\nselect = "file"\nfile = "/etc/passwd"\n'
    )
    assert (
        "files of the server"
        in problem(service.client.post("/campaigns/file", files={"toml": evil}), 422)["detail"]
    )


def test_the_scene_is_that_of_the_cell_file_in_the_posture_asked_for(service: Served, cell: Path) -> None:
    joints = [10.0, 20.0, -30.0, 0.0, 45.0, 0.0]
    asked = {"joints_deg": ",".join(map(str, joints))}
    scene = service.client.get("/cell/scene", params=asked).json()
    own = read_cell(cell)
    (expected,) = targets_at(own, np.array([joints]))
    assert np.allclose([scene["targets_mm"][name] for name in own.tool.targets], expected, atol=0.051)
    # independently: every capsule of the tool ends in its target
    ends = {each["name"].removeprefix("the tool at "): each["to_mm"] for each in scene["capsules"]}
    assert all(ends[name] == place for name, place in scene["targets_mm"].items())
    assert [each["kind"] for each in scene["obstacles"]] == ["table", "box"]
    assert scene["obstacles"][1]["high_mm"] == [450.0, 500.0, 220.0]
    for bad in ("1,2,3", "a,b,c,d,e,f", "nan,0,0,0,0,0"):
        problem(service.client.get("/cell/scene", params={"joints_deg": bad}), 422)


def test_a_dry_run_has_its_path_and_its_time(service: Served, cell: Path, tmp_path: Path) -> None:
    own = uploaded(service, tmp_path, calibration=6, validation=3, reference_every=0)
    run = service.client.post("/runs", json={"campaign_id": own}).json()
    plan = service.client.get(f"/runs/{run['id']}/plan").json()
    posed = [visit for visit in plan["visits"] if visit["kind"] == "pose"]
    assert (len(posed), sum(len(visit["readings"]) for visit in posed)) == (9, run["total"])
    assert [visit["name"] for visit in plan["visits"][:3]] == ["nest N1", "nest N2", "nest N3"]
    assert plan["seconds"] == run["seconds_left"] == pytest.approx(sum(v["seconds"] for v in posed), abs=0.5)
    (first,) = targets_at(read_cell(cell), np.array([posed[0]["joints_deg"]]))
    assert np.allclose([each["expected_mm"] for each in posed[0]["readings"]], first, atol=6e-4)
    assert np.allclose(plan["path_mm"][0], first[0], atol=0.51)
    box = np.array([[250, 350, 20], [450, 500, 220]])
    path = np.array(plan["path_mm"])
    assert not np.all((path > box[0]) & (path < box[1]), axis=1).any()
    assert 0.0 < plan["noise_mm"] < 0.2
    problem(service.client.get(f"/runs/{run['id']}/visits/5/price"), 409)  # nothing is measured
    problem(service.client.get("/runs/nothing/plan"), 404)


def test_a_pose_again_or_left_out_and_what_it_is_worth(service: Served, tmp_path: Path) -> None:
    own = uploaded(service, tmp_path, calibration=14, validation=3, reference_every=0)
    service.lease()
    run = service.client.post("/runs", json={"campaign_id": own, "dry_run": False}).json()["id"]
    until(lambda: service.client.get(f"/runs/{run}").json()["done"] >= 6)
    service.client.post(f"/runs/{run}/pause")
    service.until(f"/runs/{run}", "paused")

    def visits() -> dict[str, list[dict[str, Any]]]:
        of: dict[str, list[dict[str, Any]]] = {}
        for visit in service.client.get(f"/runs/{run}/plan").json()["visits"]:
            if visit["kind"] == "pose":
                of.setdefault(visit["readings"][-1]["status"], []).append(visit)
        return of

    before = visits()
    measured, planned = before["measured"][0], before["planned"][-1]
    retake, skip = (
        f"/runs/{run}/visits/{measured['number']}/retake",
        f"/runs/{run}/visits/{planned['number']}/skip",
    )
    problem(service.client.post(retake, headers={"Lease-Id": "guessed"}), 409)
    assert visits() == before
    viewer = {"Authorization": f"Bearer {service.hello['viewer_token']}"}
    problem(service.client.post(skip, headers=viewer), 403)

    priced = next(v for v in before["planned"] if v["set"] == "calibration")
    price = service.client.get(f"/runs/{run}/visits/{priced['number']}/price").json()
    assert price["u_without_mm"]["max"] > price["u_mm"]["max"] > 0.0
    assert price["u_without_mm"]["median"] > price["u_mm"]["median"]
    assert price["seconds"] == pytest.approx(priced["seconds"], abs=0.11)
    judged = next(v for v in (*before["planned"], *before["measured"]) if v["set"] == "validation")
    same = service.client.get(f"/runs/{run}/visits/{judged['number']}/price").json()
    assert same["u_mm"] == same["u_without_mm"] == price["u_mm"]
    problem(service.client.get(f"/runs/{run}/visits/9999/price"), 404)

    key = {"Idempotency-Key": f"{run}-once"}
    answer = service.client.post(retake, json={"reason": "somebody leaned on it"}, headers=key)
    assert answer.status_code == 202, answer.text
    service.client.post(
        retake, json={"reason": "somebody leaned on it"}, headers=key
    )  # sent twice, done once
    assert service.client.post(skip, json={"reason": "cable"}).status_code == 202
    problem(service.client.post(skip), 404)  # nothing is left to skip there
    problem(service.client.post(f"/runs/{run}/visits/9999/skip"), 404)
    now = visits()
    assert planned["number"] in [visit["number"] for visit in now["skipped"]]
    assert measured["number"] in [visit["number"] for visit in now["planned"]]
    after = service.client.get(f"/runs/{run}/visits/{priced['number']}/price").json()
    more = planned["set"] == "calibration"
    assert (after["u_mm"]["max"] > price["u_mm"]["max"]) is more

    service.client.post(f"/runs/{run}/resume")
    service.until(f"/runs/{run}", "succeeded")
    readings = [
        event["data"]
        for line in service.client.get(f"/runs/{run}/events.jsonl").text.splitlines()
        if (event := json.loads(line))["kind"] == "reading"
    ]
    again = [each["target"] for each in readings if each["name"] == measured["name"]]
    assert again == ["T1", "T2", "T3"] * 2
    assert planned["name"] not in {each["name"] for each in readings}
    dataset = service.client.post(f"/runs/{run}/dataset").json()
    assert dataset["fit"] + dataset["validation"] == 3 * (14 + 3 - 1)  # what was measured again counts once
    problem(service.client.post(retake), 409)  # it is finished
