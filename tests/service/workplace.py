"""A person at the operator page with a keyboard alone, and the checks of every view."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.drivers.waiting import until
from tests.service.browser import Page

AXE = Path(__file__).parent / "vendored" / "axe_core" / "axe.min.js"
ARMED = "document.querySelector('#confirm').getAttribute('aria-disabled') === 'false'"
MOST_TABS = 120
_TOUCHED = (
    "button, select, summary, nav a, a.do, a.btn, label.check, "
    "input:not([type=checkbox], [type=radio], [type=range], .drop *)"
)
_SMALL = f"""
    [...document.querySelectorAll("{_TOUCHED}")]
      .filter((each) => each.checkVisibility() && !each.classList.contains("gone"))
      .filter((each) => each.getBoundingClientRect().height < 59.5)
      .map((each) => each.outerHTML.slice(0, 90))
"""
_BEYOND = """
    [...document.querySelectorAll("body *")]
      .filter((each) => each.getBoundingClientRect().right > 390.5)
      .filter((each) => each.checkVisibility() && !each.closest(".scroll"))
      .map((each) => each.outerHTML.slice(0, 90))
"""
_VIOLATIONS = """
    axe.run(document, { resultTypes: ["violations"] }).then((found) => found.violations
      .map((each) => [each.id, ...each.nodes.slice(0, 4).map((node) => `${node.target}: ${node.failureSummary}`)]))
"""
_FILLED = """
    [...document.querySelectorAll(".btn.primary")].filter((each) => each.checkVisibility()).length
"""
_TYPED = """
    (async () => {
        const { promptCard } = await import("./page/prompt.js"), cards = [0, 1, 2].map(promptCard);
        const entry = { names: ["x", "y", "z"], unit: "mm", shown: [], needed: true };
        const asks = (id) => ({ id: "r", prompt: { id, text: "?", picture: "", expects: ["confirm"], entry } });
        const typed = (card) => card.querySelector("#typed");
        cards[0].show(asks("p1"), null);
        typed(cards[0]).value = "1.5 2.5";
        typed(cards[0]).dispatchEvent(new Event("input"));
        cards[1].show(asks("p1"), null);
        cards[2].show(asks("p2"), null);
        return [typed(cards[1]).value, typed(cards[2]).value];
    })()
"""


def _seen(scheme: str) -> list[dict[str, str]]:
    """The media features of a screen that is light or dark, on which nothing fades."""
    return [
        {"name": "prefers-color-scheme", "value": scheme},
        {"name": "prefers-reduced-motion", "value": "reduce"},
    ]


def tab_to(page: Page, selector: str) -> None:
    """Press Tab until the element has the focus."""
    wanted = f"document.activeElement.matches({json.dumps(selector)})"
    until(lambda: page.value(f"Boolean(document.querySelector({json.dumps(selector)}))"))
    for _ in range(MOST_TABS):
        if page.value(wanted):
            return
        page.press("Tab")
    raise AssertionError(f"no Tab leads to {selector}")


def enter_on(page: Page, selector: str) -> None:
    """Wait until it can be used, go there with Tab, press Enter."""
    until(lambda: page.value(f"document.querySelector({json.dumps(selector)})?.disabled === false || false"))
    tab_to(page, selector)
    page.press("Enter")


def open_view(page: Page, view: str) -> None:
    """Open a view by its link, with the keyboard."""
    tab_to(page, f"nav a[href='#/{view}']")
    page.press("Enter")
    until(lambda: page.value(f"document.querySelector(\"nav a[href='#/{view}']\").matches('[aria-current]')"))


def outlives_another_view(page: Page) -> None:
    """A reason that is half typed, and numbers; the next question gets neither."""
    here = page.value("location.hash")
    page.value("void (location.hash = '#/prepare')")
    until(lambda: not page.value("Boolean(document.querySelector('#reason'))"))
    page.value(f"void (location.hash = {json.dumps(here)})")
    until(lambda: page.value("document.querySelector('#reason')?.value") == "the nest is bent")
    until(lambda: page.value(ARMED))
    assert page.value(_TYPED) == ["1.5 2.5", ""]


def reachable(page: Page, selector: str) -> bool:
    """Report whether a click in the middle of an element would reach it."""
    return page.value(
        f"(() => {{ const it = document.querySelector({json.dumps(selector)}), box = it.getBoundingClientRect();"
        " return it.contains(document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2)); })()"
    )


def violations(page: Page) -> list[Any]:
    """Return what axe finds on the page as it is."""
    if not page.value("typeof axe === 'object'"):
        page.do("Runtime.evaluate", expression=AXE.read_text("utf-8"))
    return page.value(_VIOLATIONS)


def audit(page: Page) -> None:
    """Check the current view: axe finds nothing, light or dark, a telephone shows it whole, fingers hit it.

    Stop must be in reach, and no more than one button is filled.
    """
    where = page.value("location.hash")
    for scheme in ("dark", "light"):
        page.do("Emulation.setEmulatedMedia", features=_seen(scheme))
        assert not (found := violations(page)), (where, scheme, found)
    assert page.value(_FILLED) <= 1, where
    page.width(390)
    try:
        wide = page.value("document.documentElement.scrollWidth")
        assert wide <= 390, (where, wide, page.value(_BEYOND))
        small = page.value(_SMALL)
        assert not small, (where, small)
        page.value("scrollTo(0, document.body.scrollHeight)")
        assert reachable(page, "#stop"), where
        page.value("scrollTo(0, 0)")
    finally:
        page.width(1280)
