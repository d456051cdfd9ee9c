"""The operator page and its permissions, with a person in a real browser without a window.

These would catch: a page that loads or sends anything elsewhere, a script its own policy forbids, and a token that
outlives the window. They would also catch a prompt that a stray Enter answers, a reason that is lost, and a stop that
needs the mouse or the lease.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from mocks.cell import CellThread
from mocks.cell_file import read_cell
from service.http.routes.pages.page import FOLDER, MODULES, VENDORED, page_text, policy_of
from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.browser import Page, browser
from tests.service.operator_page import (
    ARMED,
    STATE,
    enter,
    events,
    in_a_browser,
    run_of,
    take_control,
)
from tests.service.test_http_support import TOKEN, Served, problem, served
from tests.service.workplace import outlives_another_view


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("page")
    cell = cell_file(folder, time_scale=40.0, one_smr=True)
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


@pytest.fixture(autouse=True)
def nobody_holds_the_lease(request: pytest.FixtureRequest) -> Iterator[None]:
    """Free the lease after each test, even a failed one, because the tests share the service."""
    service = request.getfixturevalue("service") if "service" in request.fixturenames else None
    yield
    if service is not None:
        service.free()


def test_it_needs_no_token_and_says_what_it_may_do(service: Served) -> None:
    answer = service.anybody.get("/")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    policy = answer.headers["content-security-policy"]
    (nonce,) = re.findall(r"^default-src 'none'; script-src 'nonce-([\w-]{24})'; style-src 'sha256-", policy)
    assert answer.text.count(f'<script nonce="{nonce}"') == answer.text.count("<script") == 2
    assert nonce not in service.anybody.get("/").text  # drawn anew for every answer
    assert not re.search(r"unsafe|\*|strict-dynamic", policy)
    assert TOKEN not in answer.text
    assert service.anybody.get("/", headers={"Host": "evil.example"}).status_code == 403
    assert service.anybody.post("/").status_code == 405
    module = service.anybody.get("/page/app.js")
    assert module.headers["content-type"].startswith("text/javascript")
    assert module.headers["cache-control"] == "no-store"
    assert "uPlot.esm.js" in VENDORED
    for name in VENDORED:
        library = service.anybody.get(f"/page/vendor/{name}")
        assert library.text == (FOLDER / "vendor" / name).read_text("utf-8")
    for name in ("page.html", "..%2fpage.html", "nothing.js", "vendor/app.js", "vendor/..%2fapp.js"):
        assert service.anybody.get(f"/page/{name}").status_code == 404, name


def test_it_loads_nothing_and_writes_no_markup_from_data() -> None:
    page = page_text("n")
    everything = page + "".join((FOLDER / name).read_text("utf-8") for name in MODULES)
    addresses = set(re.findall(r"https?://[^\s\"'<]+", everything))
    assert addresses == {"http://www.w3.org/2000/svg"}  # a name, which nobody fetches
    for way in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "setHTML"):
        assert way not in everything
    assert "localStorage" not in everything  # the token is forgotten with the window
    assert re.findall(r"\s((?:src|on[a-z]+)=[^\s>]+)", page) == ['src="page/app.js"']
    for name in VENDORED:  # libraries may name pages in their messages, and ask nobody
        code = (FOLDER / "vendor" / name).read_text("utf-8")
        assert not re.search(r"\beval\(|new Function\(|innerHTML|sendBeacon|WebSocket\(", code), name
    assert policy_of(page, "n") != policy_of(page.replace("grid", "Grid"), "n")


@in_a_browser
def test_a_browser_that_wants_german_gets_the_page_in_english(service: Served, tmp_path: Path) -> None:
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        page.do("Emulation.setLocaleOverride", locale="de_DE")
        page.do("Network.setExtraHTTPHeaders", headers={"Accept-Language": "de-DE,de;q=0.9"})
        page.value("localStorage.setItem('truepose-language', 'de')")  # as an older page left it
        page.do("Page.reload")
        until(lambda: page.value("document.readyState === 'complete'"))
        enter(page)
        assert page.value("document.documentElement.lang") == "en"
        assert page.text("#stop .long") == "Stop the robot"
        until(lambda: page.text("nav [aria-current] .name") == "Prepare")
        assert page.value("document.querySelectorAll('[lang]').length") == 1  # no part is in another one


@in_a_browser
def test_a_person_at_the_page(service: Served, tmp_path: Path) -> None:
    lease = {"Lease-Id": service.lease()["lease_id"]}
    run = run_of(service, tmp_path)
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        enter(page)
        until(lambda: page.value("Boolean(document.querySelector('#question'))"))
        for name in ("N1", "N2", "N3"):
            until(lambda name=name: name in page.text("#question"))
            page.press("Enter")  # by mistake: the focus is on the question, not on a button
            assert page.text("#question") == f"Put the SMR in {name}."
            assert page.value("document.activeElement.id") == "asking"
            page.press("Tab")
            assert page.value("document.activeElement.id") == "confirm"
            until(lambda: page.value(ARMED))
            page.press("Enter", held=True)  # it still lies on the key from before
            assert page.value(ARMED)
            page.press("Enter")
        until(lambda: "T1" in page.text("#question"))
        until(lambda: page.value(ARMED))
        page.value("document.querySelector('#asking details').open = true")
        page.value("document.querySelector('#reason').focus()")
        page.type("the nest is bent")
        outlives_another_view(page)
        page.click("[data-answer=skip]")
        until(lambda: "1 skipped" in page.text("#done"))
        answers = [e["data"] for e in events(service, run) if e["kind"] == "answer"]
        assert [each["answer"] for each in answers][:4] == ["confirm", "confirm", "confirm", "skip"]
        assert answers[3]["reason"] == "the nest is bent"
        answered = "Skip: http (anna holds the lease): the nest is bent"
        until(lambda: answered in page.text("#events"))

        page.click("#pause")
        until(lambda: page.value(STATE) == "paused" and page.text("#to-control") != "")
        assert page.value("document.querySelector('#resume')") is None  # somebody else is in control
        page.click("#to-control")
        assert page.value("document.querySelector('#take')") is None
        page.value("document.querySelector('#name').focus()")
        page.type("bert")
        page.click("#over")
        until(lambda: page.text("#trouble") == "Enter a reason.")
        assert page.value("document.activeElement.id") == "because"
        page.type("anna has gone home")
        page.click("#over")
        until(lambda: page.text("#holder") == "You are in control" and page.text("#control .k") == "bert")
        told = problem(service.client.post("/cell/lease", json={"holder": "anna"}, headers=lease), 409)
        assert "bert, who has taken it over from anna (anna has gone home)" in told["detail"]
        goes_on_when_loaded_again(service, page)
        until(lambda: page.text("#resume") == "Resume: the robot moves")
        page.click("#resume")
        until(lambda: page.value(STATE) == "waiting_for_operator")
        page.press("Escape")
        until(lambda: page.value(STATE) == "stopped")
        assert page.text("#trouble") == ""
        assert page.value("Object.keys(sessionStorage).sort().join()") == "truepose-lease,truepose-token"
        assert page.value("localStorage.length") == 0
        violations = [
            each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")
        ]
        assert not violations, violations
        body = {"holder": "carl", "reason": "end of the test", "seconds": 300.0}
        service.client.post("/cell/lease/takeover", json=body)
        until(lambda: "held by carl, who has taken it over" in page.text("#trouble"))  # bert is told
        assert page.text("#holder") == "carl is in control"
        assert page.value("sessionStorage.length") == 1


def goes_on_when_loaded_again(service: Served, page: Page) -> None:
    """The page keeps the secret of its lease, and continues to prolong it."""
    page.value("window.isOld = true")
    page.do("Page.reload")
    until(lambda: page.value("!window.isOld && document.readyState === 'complete'"))
    until(lambda: page.text("#holder") == "You are in control" and page.text("#control .k") == "bert")

    def expires() -> str:
        held = service.client.get("/cell").json()["lease"]
        assert held["holder"] == "bert"
        return held["expires_utc"]

    before = expires()
    until(lambda: expires() > before)
    assert page.text("#trouble") == ""


@in_a_browser
def test_an_instrument_that_was_exchanged_is_accepted_with_a_reason(tmp_path: Path) -> None:
    file = cell_file(tmp_path, time_scale=40.0)
    with CellThread(read_cell(file), devices=("abb", "faro")) as simulated:
        text = file.read_text("utf-8").replace("tcp://192.168.125.1:5000", simulated.url("abb"))
        file.write_text(text.replace("tcp://127.0.0.1:5701", simulated.url("faro")), "utf-8")
        with (
            served(tmp_path / "record", "--cell", str(file)) as service,
            browser(f"{service.url}/", tmp_path / "browser") as page,
        ):
            lease = {"Lease-Id": service.lease()["lease_id"]}
            run = run_of(service, tmp_path)
            until(lambda: service.client.get(f"/runs/{run}").json()["done"] > 0)
            service.client.post(f"/runs/{run}/pause")
            service.until(f"/runs/{run}", "paused")
            assert service.client.delete("/cell/lease", headers=lease).status_code == 204
            assert simulated.cell is not None
            bridge = simulated.cell.faro.bridge
            bridge._hello = bridge._hello.replace("X01000500000", "X777")

            page.value(f"location.hash = '#/run/{run}'")  # as addresses were before
            enter(page)
            until(lambda: page.value(STATE) == "paused")
            take_control(page, "bert")
            until(lambda: page.text("#resume") != "")
            assert page.value("document.querySelector('#individual').hidden")  # nobody knows yet
            page.click("#resume")
            until(lambda: not page.value("document.querySelector('#individual').hidden"))
            until(lambda: "another instrument answers" in page.text("#why"))
            lost = {"device": "abb", "message": "device closed the connection"}
            stay = (
                "Press the emergency stop: the program does not reach the robot, which may still be moving."
            )
            of = json.dumps({"error": lost, "reason": f"{stay} {lost['message']}. Check cable."})
            drawn = "document.createElement('p')).append(...m.reasonOf(" + of + ", {robot_driver: 'abb'}))"
            told = page.value(f"import('/page/desk.js').then((m) => {{ (window.p = {drawn}; "
                              "return [p.querySelector('.urgent').textContent, p.textContent]; })")  # fmt: skip
            assert told == [stay, f"{stay}Robot (abb): device closed the connection. Check cable."]
            page.click("#accept")
            until(lambda: page.text("#trouble") == "Enter why it was replaced.")
            assert page.value("document.activeElement.id") == "exchanged"
            page.type("calibrated elsewhere")
            page.click("#accept")
            until(lambda: page.value(STATE) == "succeeded")
            (accepted,) = (e["data"] for e in events(service, run) if e["kind"] == "other_device_accepted")
            assert (accepted["by"], accepted["reason"]) == ("bert", "calibrated elsewhere")
            assert "X777" in accepted["now"]


@in_a_browser
def test_a_wrong_token_opens_nothing_and_that_of_a_viewer_no_more_than_it_may(
    service: Served, tmp_path: Path
) -> None:
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        until(lambda: page.value("document.activeElement.id") == "token")
        page.type("wrong" * 5)
        page.press("Enter")
        until(lambda: page.text("#trouble") == "This access key does not belong to this cell.")
        assert page.value("document.querySelector('#desk').hidden")
        assert page.value("sessionStorage.length") == 0
        page.value("document.querySelector('#token').focus()")
        page.type(service.hello["viewer_token"])
        page.press("Enter")
        until(lambda: page.value("!document.querySelector('#viewer').hidden"))
        page.value("location.hash = '#/cell'")
        until(lambda: page.text("#holder") == "No one is in control")
        until(lambda: "Only an operator can start" in page.text("#next"))
        page.click("#control")
        assert not page.value(
            "[...document.querySelectorAll('#pop button, #pop input, #desk .btn.primary')]"
            ".some((e) => e.checkVisibility())"
        )
        assert not page.value("document.querySelector('#stop').disabled")


@in_a_browser
def test_the_time_left_is_a_clock_time_and_never_nothing(service: Served, tmp_path: Path) -> None:
    with browser(f"{service.url}/", tmp_path / "browser") as page:

        def left(state: str, seconds: str, done: int = 0) -> str:
            of = f"{{state: '{state}', seconds_left: {seconds}, done: {done}, total: 9}}"
            moment = "new Date(2026, 10, 20, 14, 20)"  # a Friday
            return page.value(f"import('/page/units.js').then((m) => m.timeLeft({of}, false, {moment}))")

        assert left("running", "720") == "12 min left, done at 14:32"
        assert left("running", "36000") == "10.0 h left, done at Sat, Nov 21 00:20"
        assert left("running", "0.2", 8) == "1 s left, done at 14:20"
        assert left("running", "null") == left("running", "0") == "Working out the time left"
        assert left("running", "0", 9) == "All readings done"
        assert left("waiting_for_operator", "0") == left("waiting_for_operator", "null") == "Your turn"
        assert left("paused", "50") == ""


AT_ONCE = """
    new Promise((go) => {
      const look = setInterval(() => {
        const button = document.querySelector("#confirm");
        if (!button || !button.checkVisibility()) return;
        clearInterval(look);
        button.click();
        go(document.querySelector("#question").textContent);
      }, 5);
    })
"""
# Somebody else is faster: their answer goes out before that of the page does.
FASTER = """
    (() => {
      const real = window.fetch;
      window.fetch = async (path, options) => {
        if (!/prompts/.test(path)) return real(path, options);
        window.fetch = real;
        const headers = { ...options.headers, "Idempotency-Key": "other" + path };
        await real(path.replace(/abort$/, "confirm"), { ...options, headers });
        window.wasLate = true;
        return real(path, options);
      };
      document.querySelector("#VERB").click();
    })()
"""


@in_a_browser
def test_an_answer_too_early_does_not_count_and_one_too_late_passes_quietly(
    service: Served, tmp_path: Path
) -> None:
    service.lease()
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        enter(page)
        run = run_of(service, tmp_path)
        early = page.value(AT_ONCE)
        until(lambda: page.value(ARMED))
        assert page.text("#question") == early  # the click before it could be read was none
        assert not [e for e in events(service, run) if e["kind"] == "answer"]
        page.value(FASTER.replace("VERB", "confirm"))
        until(lambda: page.text("#question") != early and page.value(ARMED))
        assert page.value("wasLate")
        assert page.text("#trouble") == ""
        page.click("#abort")  # asks once more, and nothing is sent without a reason
        until(lambda: page.value("document.activeElement.id") == "ask-keep")
        page.click("#ask-go")
        until(lambda: page.text("#trouble") == "Enter why it is ended.")
        page.type("the floor is wet")
        page.value(FASTER.replace("VERB", "ask-go"))
        until(lambda: "is not being asked" in page.text("#trouble"))  # this one has to be known
        page.press("Escape")
        service.until(f"/runs/{run}", "stopped")


@in_a_browser
def test_back_leads_to_the_run_before_and_a_link_to_its_run(service: Served, tmp_path: Path) -> None:
    campaign = tomllib.loads(campaign_file(tmp_path, calibration=4, validation=1).read_text("utf-8"))
    older, newer = (
        service.client.post("/runs", json={"campaign": campaign, "name": name}).json()["id"]
        for name in ("older", "newer")
    )

    def shown(of: str) -> bool:
        return (
            page.value("location.hash") == f"#/measure/{of}"
            and page.value(
                "!document.querySelector('#run')?.hidden && document.querySelector('#run')?.dataset.run"
            )
            == of
        )

    with browser(f"{service.url}/", tmp_path / "browser") as page:
        enter(page)
        page.value(f"location.hash = '#/measure/{newer}'")
        until(lambda: shown(newer))
        page.value(f"location.hash = '#/measure/{older}'")
        until(lambda: shown(older))
        page.value("history.back()")
        until(lambda: shown(newer))
        page.value("history.forward()")
        until(lambda: shown(older))
        page.do("Page.reload")
        until(lambda: page.value("document.readyState === 'complete'") and shown(older))
        page.value("location.hash = '#/measure/nobody-knows-it'")
        until(lambda: "There is no run 'nobody-knows-it'" in page.text("#trouble"))
        page.value("location.hash = '#/nowhere'")
        until(lambda: page.value("document.querySelector('nav [aria-current]').hash") == "#/prepare")
        assert page.value("document.querySelector('#simulated').checkVisibility()")
        what_is_dropped_is_kept_or_refused(page, (tmp_path / "campaign.toml").read_text("utf-8"))


DROP = """
    (() => {
      const held = new DataTransfer();
      held.items.add(new File([TEXT], "dropped.toml"));
      const dropped = { dataTransfer: held, bubbles: true, cancelable: true };
      document.querySelector(".drop").dispatchEvent(new DragEvent("drop", dropped));
    })()
"""


def what_is_dropped_is_kept_or_refused(page: Page, campaign: str) -> None:
    page.value("location.hash = '#/campaigns'")
    until(lambda: page.value("Boolean(document.querySelector('.drop'))"))
    page.value(DROP.replace("TEXT", json.dumps("seed = = 4")))
    until(lambda: "campaign.toml" in page.text("#trouble"))
    assert "What to do: " in page.text("#trouble")
    page.value(DROP.replace("TEXT", json.dumps(campaign)))
    until(lambda: page.value("location.hash").startswith("#/check/") and "dropped" in page.text("#steps"))
    assert page.text("#trouble") == ""
