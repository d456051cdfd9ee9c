"""The operator page: one answer, which a browser may run because its script and style have the hashes named here.

It holds nothing of the cell and needs no token; what it shows it asks for with the token that a person pastes. The
Content-Security-Policy lets it talk to this service and to nobody else.
Source: Content Security Policy Level 3 (W3C), hashes of inline scripts and styles.
"""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

router = APIRouter()
FOLDER = Path(__file__).parents[2] / "static"
STYLES = ("operator.css",)
SCRIPTS = ("connection.js", "drift.js", "given.js", "operator.js")


def page_text() -> str:
    """The page with its style and scripts in it: one text of `operator.html` and the files named here."""
    text = (FOLDER / "operator.html").read_text(encoding="utf-8")
    for tag, names in (("style", STYLES), ("script", SCRIPTS)):
        parts = ((FOLDER / name).read_text(encoding="utf-8") for name in names)
        content = "\n".join(f"<{tag}>\n{part}</{tag}>" for part in parts)
        text = text.replace(f"<{tag}></{tag}>", content)
    return text


def policy_of(page: str) -> str:
    """The Content-Security-Policy for a page: its own inline scripts and styles, its own service, nothing else."""
    script, style = (_hashes(page, tag) for tag in ("script", "style"))
    return (
        f"default-src 'none'; script-src {script}; style-src {style}; connect-src 'self'; img-src data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def _hashes(page: str, tag: str) -> str:
    parts = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
    digests = (base64.b64encode(hashlib.sha256(part.encode()).digest()).decode() for part in parts)
    return " ".join(f"'sha256-{digest}'" for digest in digests)


@router.get("/", include_in_schema=False)
def operator_page() -> HTMLResponse:
    """The page."""
    page = page_text()
    headers = {
        "Content-Security-Policy": policy_of(page),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
    return HTMLResponse(page, headers=headers)
