"""Results of a run, on the operator page and in the list behind it.

These would catch: a run that ends without a result to click, a link that a token cannot follow, and results of another
data set. They would also catch a viewer who is offered an action of the operator.
"""

from __future__ import annotations

import json
from pathlib import Path

from tests.drivers.waiting import until
from tests.end_to_end.simulated import cell_file
from tests.service.browser import Page, browser
from tests.service.operator_page import enter, in_a_browser, run_of
from tests.service.test_http_support import Served, problem, served

REPORT = "<!doctype html><title>of the test</title>"


def kept_job(record: Path, dataset: str, own: str) -> None:
    """A diagnosis that has succeeded, as the service keeps it."""
    folder = record / "diagnoses" / own
    folder.mkdir(parents=True)
    job = {"id": own, "kind": "diagnosis", "dataset_id": dataset, "created_utc": "2026-11-20T14:32:00Z"}
    for name, text in (
        ("job.json", json.dumps(job)),
        ("model.json", "{}"),
        ("report.html", REPORT),
        ("result.json", '{"converged": true}'),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def click(page: Page, text: str) -> None:
    found = (
        f"[...document.querySelectorAll('#given a, #given button')].find((e) => e.textContent === '{text}')"
    )
    page.value(f"{found}.click()")


@in_a_browser
def test_what_a_run_gave_is_one_click_away(tmp_path: Path) -> None:
    record = tmp_path / "record"
    with (
        served(record, "--cell", str(cell_file(tmp_path, time_scale=40.0)), "--simulate") as service,
        browser(f"{service.url}/", tmp_path / "browser") as page,
    ):
        service.lease()
        run = run_of(service, tmp_path)
        enter(page)
        page.value(f"location.hash = '#/run/{run}'")
        until(lambda: page.value("Boolean(document.querySelector('#files'))"))
        until(lambda: page.text("#state") == "✔ succeeded")
        until(lambda: "events.jsonl" in page.text("#files"))
        assert "data.csv" not in page.text("#files")
        click(page, "Make the data set")
        until(lambda: "data.csv" in page.text("#files"))
        (dataset,) = service.client.get("/datasets").json()["datasets"]
        assert dataset["run_id"] == run

        kept_job(record, dataset["id"], "29991120-143200-a")
        kept_job(record, "of-another-one", "29991120-143300-b")
        assert lists_its_own_only(service, dataset["id"]) == ["29991120-143200-a"]
        page.do("Page.reload")
        until(lambda: page.value("document.readyState === 'complete'"))
        until(lambda: page.value("Boolean(document.querySelector('#files'))"))
        until(lambda: page.text("#files").count("diagnosis ") == 1)
        bad = "{id: 'x', kind: 'diagnosis', state: 'succeeded', created_utc: '2026-11-20', result: {converged: false}}"
        words = f"m.rowOfJob({bad}).slice(1).map((each) => each.textContent || each).join()"
        told = page.value(f"import('/page/given.js').then((m) => {words})")
        assert told == "It has not converged: no model.,download report"
        click(page, "Identify")
        until(lambda: page.value("location.hash").startswith("#/result/"))
        until(lambda: "identification" in page.text("#desk h2"))
        page.value("history.back()")
        until(lambda: page.value("Boolean(document.querySelector('#files'))"))
        until(lambda: "identification " in page.text("#files"))

        saved = tmp_path / "saved"
        page.do("Page.setDownloadBehavior", behavior="allow", downloadPath=str(saved))
        for text, path, name in (
            ("download report", "/reports/29991120-143200-a", "29991120-143200-a-report.html"),
            ("data.csv", f"/datasets/{dataset['id']}/data.csv", f"{dataset['id']}.csv"),
            ("events.jsonl", f"/runs/{run}/events.jsonl", f"{run}-events.jsonl"),
        ):
            click(page, text)
            until((saved / name).is_file)
            content = service.client.get(path).content
            assert content
            until(lambda content=content, name=name: (saved / name).read_bytes() == content)
        assert page.text("#trouble") == ""
        assert not [each for each in page.told if each["method"] in ("Log.entryAdded",)]

        page.click("#out")
        until(lambda: page.value("document.activeElement.id") == "token")
        page.type(service.hello["viewer_token"])
        page.press("Enter")
        until(lambda: page.value("!document.querySelector('#viewer').hidden"))
        until(
            lambda: (
                page.value("Boolean(document.querySelector('#files'))") and "report" in page.text("#files")
            )
        )
        assert not page.value(
            "[...document.querySelectorAll('#given button')].some((b) => b.checkVisibility())"
        )


def lists_its_own_only(service: Served, dataset: str) -> list[str]:
    problem(service.client.get("/datasets/nothing/jobs"), 404)
    return [job["id"] for job in service.client.get(f"/datasets/{dataset}/jobs").json()["jobs"]]
