"""Problems: everything that goes wrong, as `application/problem+json` (RFC 9457).

In addition to the standard members, a problem has these:

- `code`, which is that of `drivers.errors`, or 8xxx for the errors of the service.
- `operator_text`, one sentence on the event.
- `what_to_do`, one sentence for the person at the cell.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.responses import Response

from acquisition.errors import DamagedRecord, OtherIndividual, StorageError, UnsafePlan
from calib.errors import DataError
from drivers.errors import AcquisitionError, ConfigError, JointLimit, LinkError
from fleet.errors import StoreError, StoreGone
from service import refusals
from service.refusals import REFUSALS, Refusal

MEDIA_TYPE = "application/problem+json"
_CODES = {
    401: 8001,
    403: 8002,
    404: 8004,
    405: 8005,
    409: 8009,
    411: 8011,
    413: 8013,
    415: 8015,
    422: 8022,
    500: 8500,
}
_STATUS: tuple[tuple[type[Refusal], int], ...] = (
    (StoreGone, 503),
    (StoreError, 500),
    (DataError, 422),
    (UnsafePlan, 422),
    (JointLimit, 422),
    (ConfigError, 422),
    (DamagedRecord, 422),
    (StorageError, 507),
    (LinkError, 502),
    (ModuleNotFoundError, 501),
)


class Problem(HTTPException):
    """A refusal by the service itself. `more`: further members of the document."""

    def __init__(
        self,
        status: int,
        text: str,
        do: str,
        *,
        code: int | None = None,
        headers: dict[str, str] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(status, text, headers)
        self.do, self.code, self.more = do, code, more


def not_found(what: str, name: str) -> Problem:
    """Create a problem with status 404."""
    what = what.replace("_", " ")
    several = re.sub("is$", "e", what) + ("es" if what.endswith("ch") else "s")
    return Problem(404, f"There is no {what} {name!r}.", f"List the {several} to see which there are.")


def document(status: int, text: str, do: str, code: int | None = None, **more: Any) -> dict[str, Any]:
    """Return the members of a problem."""
    known = _CODES.get(status, 8000)
    return {
        "type": f"urn:truepose:problem:{code or known}",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": text,
        "code": code or known,
        "operator_text": text,
        "what_to_do": do,
        **more,
    }


def response(
    status: int,
    text: str,
    do: str,
    code: int | None = None,
    headers: dict[str, str] | None = None,
    **more: Any,
) -> JSONResponse:
    """Create a response with a problem as its body."""
    return JSONResponse(
        document(status, text, do, code, **more), status, headers=headers, media_type=MEDIA_TYPE
    )


def install(app: FastAPI) -> None:
    """Turn each error of the service into a problem document.

    The handlers are coroutines. Other functions would run in an ordinary thread, and the refusal of a stop would
    have to wait for one.
    """
    app.add_exception_handler(HTTPException, _of_http)
    app.add_exception_handler(RequestValidationError, _of_request)
    for refused in REFUSALS:
        app.add_exception_handler(refused, _of_refusal)
    app.add_exception_handler(OSError, _of_disk)
    app.add_exception_handler(Exception, _of_fault)


async def _of_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    if isinstance(error, Problem):
        return response(error.status_code, error.detail, error.do, error.code, headers, **error.more)
    path, method = request.url.path[:200], request.method
    known = {404: f"There is nothing under {path!r}.", 405: f"{path!r} does not take {method!r}."}
    said = str(error.detail or HTTPStatus(error.status_code).phrase).rstrip(".") + "."
    text = known.get(error.status_code, said)
    return response(error.status_code, text, "Look at /openapi.json for what can be asked.", headers=headers)


async def _of_request(request: Request, error: Exception) -> Response:
    """Answer a request whose body or parameters are invalid.

    The values that were sent are left out: they may be NaN, which JSON cannot carry, or secret.
    """
    assert isinstance(error, RequestValidationError)
    errors = [
        {"where": ".".join(str(part) for part in each["loc"]), "what": _in_words(each)}
        for each in error.errors()
    ]
    first = errors[0] if errors else {"where": "the request", "what": "cannot be read"}
    text = f"{first['where']}: {first['what']}."
    do = "Correct the request; /openapi.json describes it."
    kind = request.headers.get("content-type", "")
    if first["where"] == "body" and "json" not in kind:  # curl -d sends another type by default
        do = f"Send JSON, with Content-Type: application/json; it came as {kind[:100] or 'nothing'}."
    return response(422, text, do, errors=errors)


def _in_words(error: Mapping[str, Any]) -> str:
    """Describe one error of a body.

    The library's words are used, except those that name parts of the library.
    """
    if error["type"] == "string_pattern_mismatch" and error["ctx"]["pattern"] == r"\S":
        return "is blank"
    return str(error["msg"]).removeprefix("Value error, ")


def of_error(error: Refusal) -> dict[str, Any]:
    """Return the members of a problem for an error of a device, the record or a file."""
    status = next((status for kind, status in _STATUS if isinstance(error, kind)), 409)
    code = error.code or None if isinstance(error, AcquisitionError) else None
    members = refusals.place(error)
    if isinstance(error, OtherIndividual):
        members["serial"] = error.serial
    return document(status, refusals.cause(error), refusals.remedy(error), code, **members)


async def _of_refusal(request: Request, error: Exception) -> Response:
    assert isinstance(error, REFUSALS)
    document = of_error(error)
    return JSONResponse(document, document["status"], media_type=MEDIA_TYPE)


async def _of_disk(request: Request, error: Exception) -> Response:
    """Answer a failure to write or read a record of the service.

    The path of the record is only for the log.
    """
    assert isinstance(error, OSError)
    logging.getLogger(__name__).error("%s %s: %s", request.method, request.url.path, error)
    return await _of_refusal(request, refusals.of_disk(error))


async def _of_fault(request: Request, error: Exception) -> Response:
    """Answer a fault of this program; the log of the server has the details."""
    return response(
        500, "The service has met a fault of its own.", "Note what was asked and look at the service's log."
    )
