"""The OpenAPI document, compared with the program, for the programmer of a cell PC.

These would catch: a field or parameter without description, unit or example, and a free object although its type is
known. They would also catch an outdated list of states, verdicts or events, and a campaign that the schema refuses but
the reader accepts.
"""

from __future__ import annotations

import ast
import asyncio
import re
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import httpx2
import pytest
from pydantic import TypeAdapter, ValidationError

from acquisition import State
from calib.diagnose.diagnosis import Verdict
from service import job, job_folder
from service.exports import FORMATS
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.wire.bodies import CampaignTable, EventKind, ExportKind, ModelShown, requests
from service.http.work import jobs
from service.http.work.campaigns import campaign_of
from service.results.cell.arrows import ArrowsShown
from service.results.models.diagnosed import DiagnosisResult
from service.results.models.identified import IdentificationResult
from service.results.models.regressed import RegressionResult
from tests.end_to_end.simulated import ROOT
from tests.service.campaigns import write_data

UNITS = re.compile(
    r"\b(mm|um|mrad|deg|rad|s|ms|min|Hz|kg|degC|hPa|ppm|mm/s|deg/s|m/s2|[Nn]umbers?|[Pp]robability|[Ss]hare|ratio|"
    r"[Nn]o unit|with unit|without a unit|in `unit`)(?=[\s.,;:)]|$)"
)
FREE = {
    "EventShown.data",
    "NewVerification.model",
    "SelectionAsked.prior",
    "ToDiagnose.prior",
    "ToIdentify.prior",
}
"""What an event says beside its kind differs from kind to kind: see `streamEvents`. A prior and a model are the
content of a file, which its reader checks."""


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return create_app(ServiceSettings(tmp_path_factory.mktemp("openapi"), Tokens("o", "v"))).openapi()


def fields(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every parameter and every member of every object, by name."""
    for path, item in document["paths"].items():
        for method, operation in item.items():
            for each in operation.get("parameters", ()):
                told = each["schema"] | {k: v for k, v in each.items() if k == "description"}
                yield f"{method} {path} {each['name']}", told
    for name, schema in document["components"]["schemas"].items():
        for key, member in schema.get("properties", {}).items():
            yield f"{name}.{key}", member


def kinds(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A schema and its alternatives and elements."""
    yield schema
    for each in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        yield from kinds(each)
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from kinds(schema[key])


def test_every_field_and_parameter_is_described_with_an_example(document: dict[str, Any]) -> None:
    seen = dict(fields(document))
    assert len(seen) > 300
    assert [name for name, told in seen.items() if len(told.get("description", "")) < 5] == []
    files = {"contentMediaType", "format"}
    assert [name for name, told in seen.items() if not told.get("examples") and not files & set(told)] == []


def test_it_says_the_rules_of_the_cell_pc_itself(document: dict[str, Any]) -> None:
    """The description alone explains heartbeat, keys, long poll and stop as docs/cell-pc does."""
    rules = re.findall(r"^\d\. \*\*(.*?)\.\*\*", (ROOT / "docs/cell-pc/README.md").read_text("utf-8"), re.M)
    told = document["info"]["description"]
    assert len(rules) == 5
    assert re.findall(r"^\d\. \*\*(.*?)\.\*\*", told, re.M) == rules
    for word in ("Lease-Id", "Idempotency-Key", "Idempotent-Replay", "wait=20&after=", "409", "/stop"):
        assert word in told


def test_operations_are_grouped_by_the_steps_of_the_page_with_the_core_first(
    document: dict[str, Any],
) -> None:
    names = [each["name"] for each in document["tags"]]
    steps = (ROOT / "docs/operator.md").read_text("utf-8")
    assert names[0] == "Core"
    assert [each for each in names if f"| {each} `#/" in steps][:6] == re.findall(
        r"^\| (\w+) `#/", steps, re.M
    )[:6]
    tags = {
        each["operationId"]: each["tags"] for item in document["paths"].values() for each in item.values()
    }
    assert {name for given in tags.values() for name in given} == set(names)
    assert [
        name for name, given in tags.items() if len([each for each in given if each != "Core"]) != 1
    ] == []


def test_every_number_has_its_unit(document: dict[str, Any]) -> None:
    without = [
        name
        for name, told in fields(document)
        if any(each.get("type") in ("number", "integer") and "enum" not in each for each in kinds(told))
        and not UNITS.search(told["description"])
    ]
    # the id of a reading is a number or text, as somebody chose it
    assert [name for name in without if not re.search(r"readings?$|_rows$|\.index$", name)] == []


def test_no_object_is_free_where_its_type_is_known(document: dict[str, Any]) -> None:
    bodies = {
        f"{method} {path} {status}": content["schema"]
        for path, item in document["paths"].items()
        for method, operation in item.items()
        for status, answer in operation["responses"].items()
        for content in answer.get("content", {}).values()
    }
    free = {
        name
        for name, told in (*fields(document), *bodies.items())
        for each in kinds(told)
        if (
            each.get("type") == "object"
            and not each.get("properties")
            and not isinstance(each.get("additionalProperties"), dict)
        )
        or not {"type", "$ref", "anyOf", "oneOf", "allOf", "const", "enum"} & set(each)
    }
    assert free == FREE


def test_states_verdicts_and_kinds_are_enumerations(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    assert schemas["State"]["enum"] == [state.value for state in State]
    for name in ("RunResponse", "LoopShown", "JobResponse", "DiagnosisShown"):
        assert schemas[name]["properties"]["state"]["$ref"] == "#/components/schemas/State"
    assert schemas["DiagnosisResult"]["properties"]["verdict"]["enum"] == list(get_args(Verdict))
    assert set(schemas["JobResponse"]["properties"]["kind"]["enum"]) == set(jobs._FOLDERS)
    assert {"run", "dataset", "campaign", *jobs._FOLDERS} == set(
        schemas["DeletionShown"]["properties"]["kind"]["enum"]
    )
    assert set(get_args(ExportKind)) == set(FORMATS)
    assert schemas["EventShown"]["properties"]["kind"]["enum"] == list(get_args(EventKind))


def test_the_kinds_of_events_are_those_that_the_program_writes() -> None:
    """The kinds are read from the source: the first word in each call that notes an event."""
    written = {"deferred", "skipped"}  # by `Store.mark`, which has them from its caller
    for file in (ROOT / "acquisition").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
                known = node.args[-1] if node.func.attr == "note" else node.args[0]
                notes = node.func.attr in ("note", "add_event", "_add_event") and node.keywords
                if notes and isinstance(known, ast.Constant) and re.fullmatch(r"[a-z_]+", str(known.value)):
                    written.add(str(known.value))
    assert written <= set(get_args(EventKind)), written - set(get_args(EventKind))
    assert len(written) > 25


def test_the_campaign_offers_no_file_and_no_default_of_what_is_inherited(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    blocks = [each for name, each in schemas.items() if name.endswith("Block")]
    assert len(blocks) == 10
    for block in blocks:
        own = block["properties"]
        assert "file" not in own
        assert "file" not in own.get("select", {}).get("enum", ())
        assert not any("default" in own[key] for key in ("approach", "settle_s", "settle_check"))
    assert not any("default" in each for each in schemas["ApproachTable"]["properties"].values())


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*/*campaign*.toml")), ids=str)
def test_the_schema_takes_the_campaigns_of_the_examples(path: Path) -> None:
    TypeAdapter(CampaignTable).validate_python(tomllib.loads(path.read_text("utf-8")))


def test_the_schema_refuses_a_campaign_without_blocks() -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(CampaignTable).validate_python({"format": "truepose-campaign/1"})


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"), n=50)


def test_results_are_as_described(data: Path, tmp_path: Path) -> None:
    """Every member that the schema demands exists with its type, and no other member exists."""
    from calib.text import read_json

    done = {
        "identification": IdentificationResult,
        "diagnosis": DiagnosisResult,
        "regression": RegressionResult,
    }
    limits = {"rms": 0.05, "largest": None}
    for kind, model in done.items():
        folder = tmp_path / kind
        folder.mkdir()
        if kind == "regression":
            order = {
                "on": "residuals",
                "kernel": "linear",
                "features": None,
                "level": 3,
                "both": False,
                "diagnosed": False,
            }
            job.regression(folder, {"data": str(data), "order": order})
        else:
            more = {"patch": True, "carry_to": str(data)} if kind == "diagnosis" else {}
            getattr(job, kind)(folder, {"data": str(data), "limits": limits, **more})
        result = read_json(folder / job_folder.RESULT)
        assert unnamed(model.model_validate(result)) == set()
        if kind != "regression":
            arrows = ArrowsShown.model_validate(read_json(folder / job_folder.ARROWS))
            assert unnamed(arrows) == set()
            assert len(arrows.arrows) == arrows.readings > 0
        if kind == "diagnosis":
            assert result["acceptance"]["criteria"][0]["limit_mm"] == 0.05
            ModelShown.model_validate(read_json(folder / job_folder.MODEL))


def unnamed(model: Any, where: str = "") -> set[str]:
    """Members of a document that its model does not name."""
    out = {f"{where}.{name}" for name in getattr(model, "model_extra", None) or {}}
    for name in type(model).model_fields if hasattr(type(model), "model_fields") else ():
        value = getattr(model, name)
        for each in value if isinstance(value, list) else [value]:
            out |= unnamed(each, f"{where}.{name}")
    return out


def test_examples_of_requests_can_be_sent(document: dict[str, Any]) -> None:
    """The service accepts the requests that the page of the description offers to send."""
    for model in (requests.NewRun, requests.NewLoop, requests.TargetsToCorrect):
        (example,) = document["components"]["schemas"][model.__name__]["examples"]
        model.model_validate(example)
    campaign_of(requests.CAMPAIGN)


def test_the_document_is_made_once_and_not_in_the_loop_of_events(tmp_path: Path) -> None:
    """It takes seconds, for which no stop would be heard."""
    app = create_app(ServiceSettings(tmp_path, Tokens("o", "v")))
    makers: list[threading.Thread] = []
    whole = app.openapi

    def noted() -> dict[str, Any]:
        makers.append(threading.current_thread())
        return whole()

    app.openapi = noted

    async def ask() -> list[httpx2.Response]:
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            together = await asyncio.gather(*(client.get("/openapi.json") for _ in range(3)))
            return [*together, await client.get("/openapi.json")]

    answers = asyncio.run(ask())
    assert [each.json()["info"]["title"] for each in answers] == ["TruePose"] * 4
    assert len(makers) == 1
    assert makers[0] is not threading.current_thread()


def test_who_does_not_read_the_document_is_sent_its_beginning_only(tmp_path: Path) -> None:
    """Written whole, the document would be in memory once per client.

    Its copies would also hold up the event loop.
    """
    app = create_app(ServiceSettings(tmp_path, Tokens("o", "v")))
    sent = list[bytes]()

    async def ask() -> None:
        full = asyncio.Event()

        async def send(message: Any) -> None:
            if message["type"] == "http.response.body":
                sent.append(message["body"])
                full.set()
                await asyncio.Event().wait()  # the client reads nothing

        async def receive() -> Any:
            await asyncio.Event().wait()

        scope = {
            "type": "http",
            "method": "GET",
            "path": "/openapi.json",
            "query_string": b"",
            "headers": [(b"host", b"127.0.0.1")],
            "app": app,
        }
        asking = asyncio.create_task(app(scope, receive, send))
        await full.wait()
        asking.cancel()

    asyncio.run(ask())
    assert 0 < sum(map(len, sent)) <= 65536
