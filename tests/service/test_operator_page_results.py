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


def lists_its_own_only(service: Served, dataset: str) -> list[str]:
    problem(service.client.get("/datasets/nothing/jobs"), 404)
    return [job["id"] for job in service.client.get(f"/datasets/{dataset}/jobs").json()["jobs"]]
