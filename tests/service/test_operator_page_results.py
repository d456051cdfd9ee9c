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


def kept_job(record: Path, dataset: str, own: str, **files: object) -> None:
    """A diagnosis that has succeeded, as it is kept; `files` are JSON files by name."""
    folder = record / "diagnoses" / own
    folder.mkdir(parents=True)
    job = {"id": own, "kind": "diagnosis", "dataset_id": dataset, "created_utc": "2026-11-20T14:32:00Z"}
    for name, text in (
        ("job.json", json.dumps(job)),
        ("model.json", "{}"),
        ("report.html", REPORT),
        ("result.json", '{"converged": true}'),
        *((f"{each}.json", json.dumps(content)) for each, content in files.items()),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def unjudged(verdict: str) -> dict[str, object]:
    """A result without readings held out and without effects, of a robot that was verified."""
    errors = {"n": 52, "mean": 0.4, "rms": 0.5, "p95": 0.8, "max": 1.0}
    proof = {"poses": 13, "error_uncorrected_mm": errors, "error_verified_mm": {**errors, "rms": 0.05}}
    return {"converged": True, "verdict": verdict, "effects": [], "finding": "F.", "verification": proof}


def choose(page: Page, place: str, text: str) -> None:
    """Choose an entry of the first menu in a place, as soon as it is offered."""

    def chosen() -> bool:
        return page.value(
            f"(() => {{ const at = document.querySelector({json.dumps(place)}), open = at?.querySelector('.more');"
            " if (!open || open.hidden) return false; if (open.getAttribute('aria-expanded') === 'false') open.click();"
            f" const it = [...at.querySelectorAll('.menu button')].find((b) => b.textContent === {json.dumps(text)});"
            " if (it) it.click(); else open.click(); return Boolean(it); })()"
        )

    until(chosen)


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
        until(lambda: page.value("location.hash").startswith("#/diagnose/"))  # without a click
        (dataset,) = service.client.get("/datasets").json()["datasets"]
        assert dataset["run_id"] == run
        (own,) = lists_its_own_only(service, dataset["id"])
        assert page.value("location.hash") == f"#/diagnose/{own}"
        service.until(f"/diagnoses/{own}", "succeeded", "failed")

        kept_job(record, dataset["id"], "29991120-143200-a")
        kept_job(record, "of-another-one", "29991120-143300-b")
        assert lists_its_own_only(service, dataset["id"]) == ["29991120-143200-a", own]
        bad = "{id: 'x', kind: 'diagnosis', state: 'succeeded', result: {converged: false}}"
        told = page.value(f"import('/page/data.js').then((m) => m.outcome({bad}))")
        assert told == "It has not converged: no model."
        page.value("location.hash = '#/data'")
        until(lambda: page.text("#datasets").count("diagnosis ") == 2)
        choose(page, "#datasets", "Identify")
        until(lambda: page.value("location.hash").startswith("#/diagnose/"))
        until(lambda: "identification" in page.text("#job"))
        page.value("history.back()")
        until(lambda: "identification " in page.text("#datasets"))

        saved = tmp_path / "saved"
        page.do("Page.setDownloadBehavior", behavior="allow", downloadPath=str(saved))
        for view, text, path, name in (
            ("data", "Download data.csv", f"/datasets/{dataset['id']}/data.csv", f"{dataset['id']}.csv"),
            (
                "diagnose/29991120-143200-a",
                "Download the report",
                "/reports/29991120-143200-a",
                "29991120-143200-a-report.html",
            ),
            (
                f"measure/{run}",
                "Download the record (events.jsonl)",
                f"/runs/{run}/events.jsonl",
                f"{run}-events.jsonl",
            ),
        ):
            page.value(f"location.hash = '#/{view}'")
            choose(page, "#desk", text)
            until((saved / name).is_file)
            content = service.client.get(path).content
            assert content
            until(lambda content=content, name=name: (saved / name).read_bytes() == content)
        page.value("location.hash = '#/robots'")  # the list of runs has the state and the last result
        until(lambda: "Done" in page.text("#runs") and "readings" in page.text("#runs"))
        assert page.text("#trouble") == ""
        told = [json.dumps(each) for each in page.told if each["method"] == "Log.entryAdded"]
        assert all("29991120-143200-a/arrows" in each for each in told)  # the made-up result has none

        page.click("#out")
        until(lambda: page.value("document.activeElement.id") == "token")
        page.type(service.hello["viewer_token"])
        page.press("Enter")
        until(lambda: page.value("!document.querySelector('#viewer').hidden"))
        page.value("location.hash = '#/data'")
        until(lambda: page.text("#datasets").count("diagnosis ") == 2)
        assert not page.value(
            "[...document.querySelectorAll('#datasets li > .row > .btn')].some((b) => b.checkVisibility())"
        )
        assert not page.value("[...document.querySelectorAll('.menu .bad')].length")


@in_a_browser
def test_a_result_tells_one_truth_of_what_judged_it(tmp_path: Path) -> None:
    """No reading of the calibration is shown as held out, and no unexplained error as explained."""
    record, arrow = tmp_path / "record", {"reading": "1", "at_mm": [500, 0, 500], "nominal_mm": [1, 0, 0]}
    arrows = {"format": "truepose-arrows/1", "readings": 1, "arrows": [{**arrow, "model_mm": [0.1, 0, 0]}]}
    for own, verdict, held_out in (("noisy-1", "excess_noise", False), ("clear-1", "complete", True)):
        kept_job(record, "none", own, result=unjudged(verdict), arrows={**arrows, "held_out": held_out})
    with (
        served(record, "--cell", str(cell_file(tmp_path, time_scale=40.0)), "--simulate") as service,
        browser(f"{service.url}/", tmp_path / "browser") as page,
    ):
        enter(page)
        for own, cause, rows in (
            ("noisy-1", "Cause not known", "1 readings of the calibration"),
            ("clear-1", "No further cause", "1 readings that took no part"),
        ):
            page.value(f"location.hash = '#/diagnose/{own}'")
            until(lambda cause=cause: cause in page.text("#desk"))
            until(lambda rows=rows: rows in page.text("#desk"))
            shown = page.text("#desk")
            assert ("A standard calibration explains" in shown) == (own == "clear-1")
            assert page.text(".was") == "0.50"
            assert page.text(".now") == "0.05"
            assert "measured on the robot, at 13 new poses" in shown
            assert cause in page.text("#steps [data-name=diagnose]")
            gap = "parseFloat(getComputedStyle(document.querySelector('fieldset.row')).columnGap)"
            inner = "parseFloat(getComputedStyle(document.querySelector('fieldset.row .check')).columnGap)"
            assert page.value(f"{gap} > {inner}")  # a button belongs to the word beside it


def lists_its_own_only(service: Served, dataset: str) -> list[str]:
    problem(service.client.get("/datasets/nothing/jobs"), 404)
    return [job["id"] for job in service.client.get(f"/datasets/{dataset}/jobs").json()["jobs"]]
