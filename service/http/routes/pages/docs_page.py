"""`/docs`: the OpenAPI document to read and to try, with the Swagger UI of fastapi-offline.

It holds nothing of the cell and needs no token. A trial request has the token that a person pastes under
"Authorize". Its policy lets it run the two scripts that come with it and talk only to this service. Source:
Content Security Policy Level 3 (W3C).
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse

from service.http.wire.problems import Problem

router = APIRouter()
_OURS = "docs.js"
FILES = {
    "swagger-ui-bundle.js": "text/javascript",
    _OURS: "text/javascript",
    "swagger-ui.css": "text/css",
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>TruePose: the interface</title>
<link rel="icon" href="data:,"><link rel="stylesheet" href="/docs/swagger-ui.css"></head>
<body><div id="docs"></div>
<script src="/docs/swagger-ui-bundle.js"></script><script src="/docs/docs.js"></script></body>
</html>
"""


@router.get("/docs", include_in_schema=False)
def docs_page() -> HTMLResponse:
    """Serve the page."""
    return HTMLResponse(PAGE, headers=HEADERS)


@router.get("/docs/{name}", include_in_schema=False)
def docs_file(name: str) -> FileResponse:
    """Return a file of the page.

    Raises
    ------
    Problem
        404: the page has no such file.
    """
    if name not in FILES:
        raise Problem(404, f"There is no file {name!r} of the page.", "Open /docs.")
    folder = Path(__file__).parents[3] / "static" if name == _OURS else files("fastapi_offline") / "static"
    return FileResponse(str(folder / name), media_type=FILES[name], headers=HEADERS)
