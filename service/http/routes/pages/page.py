"""The operator page: a frame in which a browser runs the modules of the service.

It holds nothing of the cell and needs no token. It requests its content with the token that a person pastes.
The Content-Security-Policy lets it talk only to this service. Its scripts are recognised by a number that is
drawn for every answer; text that another party writes into the page does not have it. Modules that a recognised
one imports are recognised too. Libraries of others are in `static/vendor`, unchanged. Source: Content Security
Policy Level 3 (W3C), nonces, and hashes of inline styles.
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from functools import cache
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import HTMLResponse, Response

from service.http.wire.problems import not_found

router = APIRouter()
FOLDER = Path(__file__).parents[3] / "static"
MODULES = tuple(sorted(path.name for path in FOLDER.glob("*.js")))
VENDORED = tuple(sorted(path.name for path in (FOLDER / "vendor").glob("*.js")))
_STYLES = ("vendor/uPlot.min.css", "tokens.css", "page.css")
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",  # a page and its modules are of one version
}


@cache
def page_hash() -> str:
    """Return the hash of the page.

    By it an open page checks whether a service that is back still has the same page.
    """
    texts = (path.read_bytes() for path in sorted(FOLDER.rglob("*")) if path.is_file())
    return hashlib.sha256(b"".join(texts)).hexdigest()[:12]


def page_text(nonce: str) -> str:
    """Return the page with its style in it, and its scripts marked with this number."""
    text, *styles = ((FOLDER / name).read_text(encoding="utf-8") for name in ("page.html", *_STYLES))
    style = "\n".join(styles)
    text = text.replace("<style></style>", f"<style>{style}</style>")
    text = text.replace('<html lang="en">', f'<html lang="en" data-page="{page_hash()}">')
    return text.replace("<script ", f'<script nonce="{nonce}" ')


def policy_of(page: str, nonce: str) -> str:
    """Return the Content-Security-Policy for a page.

    It allows only the page's own script and style, and its own service.
    """
    styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    digests = (base64.b64encode(hashlib.sha256(each.encode()).digest()).decode() for each in styles)
    style = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src {style}; connect-src 'self'; img-src data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


@router.get("/", include_in_schema=False)
def operator_page() -> HTMLResponse:
    """Serve the page."""
    nonce = secrets.token_urlsafe(18)
    page = page_text(nonce)
    return HTMLResponse(page, headers=_HEADERS | {"Content-Security-Policy": policy_of(page, nonce)})


def _script(folder: Path, names: tuple[str, ...], name: str) -> Response:
    if name not in names:
        raise not_found("module", name)
    text = (folder / name).read_text(encoding="utf-8")
    return Response(text, media_type="text/javascript; charset=utf-8", headers=_HEADERS)


@router.get("/page/{name}", include_in_schema=False)
def module(name: str) -> Response:
    """Serve a module of the page."""
    return _script(FOLDER, MODULES, name)


@router.get("/page/vendor/{name}", include_in_schema=False)
def vendored(name: str) -> Response:
    """Serve a library that the page uses."""
    return _script(FOLDER / "vendor", VENDORED, name)
