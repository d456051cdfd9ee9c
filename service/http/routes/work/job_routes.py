"""Jobs of the service: a table of what can be asked for, its request, its answer, and how it is put in the queue.

A job is asked for by POST on its collection and looked at by GET with its id; nothing here moves the robot.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response

from service import history_calls
from service.files import as_json
from service.http.routes.json_route import JsonRoute
from service.http.routes.work.result_routes import REPORT_HEADERS
from service.http.state import Here, Service
from service.http.wire.bodies import (
    AlignmentShown,
    DiagnosisShown,
    IdentificationShown,
    PlacementsAsked,
    PlacementsShown,
    RegressionAsked,
    RegressionShown,
    ResponseBody,
    SelectionAsked,
    SelectionShown,
    SweepsAsked,
    SweepsShown,
    ToDiagnose,
    ToFit,
    ToIdentify,
    ValidationAsked,
    ValidationShown,
)
from service.http.wire.bodies.fields import RequestBody
from service.http.wire.bodies.jobs import (
    UpkeepShown,
    UpkeepsShown,
    WatchesShown,
    WatchPlanShown,
    WatchPlansShown,
    WatchShown,
)
from service.http.wire.bodies.watches import (
    BaselineReference,
    ReadingsReference,
    UpkeepAsked,
    WatchPlanAsked,
    WatchRequestBody,
)
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem, not_found
from service.http.wire.tags import Tag
from service.http.work.idempotency import begun
from service.http.work.paging import LINKED, NewestPage
from service.job_folder import PRIOR
from service.kept_dataset import CSV
from service.results.cell.placements import PlacementRequest, wanted_of

router = APIRouter(route_class=JsonRoute)
Begin = Callable[[Service, Any], dict[str, Any]]


def _readings_of(here: Service, dataset_id: str) -> dict[str, Any]:
    """What a job on a data set is told of it. Raises Problem 404."""
    dataset = here.datasets.get(dataset_id)
    return {"dataset_id": dataset["id"], "data": str(here.datasets.path(dataset["id"]) / CSV)}


def _type_file(prior: dict[str, Any]) -> dict[str, bytes]:
    return {PRIOR: as_json(prior).encode()} if prior else {}


def _fit(here: Service, kind: str, body: ToFit, more: dict[str, Any]) -> dict[str, Any]:
    cell, limits = here.settings.cell, body.limits
    asked = {
        "cell": None if cell is None else cell.source,
        "limits": None if limits is None else asdict(limits),
        **body.options,
        **more,
    }
    return here.jobs.add(kind, _readings_of(here, body.dataset_id) | asked, _type_file(body.prior))


def create_identification(here: Service, body: ToIdentify) -> dict[str, Any]:
    """Identify the robot of a data set, and hold the error on readings held out to limits where there are some."""
    return _fit(here, "identification", body, {})


def create_diagnosis(here: Service, body: ToDiagnose) -> dict[str, Any]:
    """Identify the robot of a data set and find what its model lacks.

    The error on readings held out is held to limits where there are some: `result.acceptance`.
    Where something is ambiguous, `result.follow_up` holds a campaign that decides it, within the cell of this
    service: POST it to /runs.
    """
    other = {"carry_to": _readings_of(here, body.carry_to)["data"]} if body.carry_to else {}
    return _fit(here, "diagnosis", body, other)


def create_regression(here: Service, body: RegressionAsked) -> dict[str, Any]:
    """Compare MLS-SVR with identification on a data set.

    The model that it is based on is saved with the regression, where that gains; its targets are at /models.
    """
    order = {
        "on": body.on,
        "kernel": body.kernel,
        "features": body.features,
        "level": body.level,
        "both": body.compare,
        "diagnosed": body.diagnose,
    }
    return here.jobs.add("regression", _readings_of(here, body.dataset_id) | {"order": order})


def create_validation(here: Service, body: ValidationAsked) -> dict[str, Any]:
    """Judge a saved model on a data set; without a model compare kinds of hold-out of the data set."""
    readings, limits = _readings_of(here, body.dataset_id), body.limits
    model = str(here.jobs.model_file(body.model_id)) if body.model_id else None
    if model is None and (limits or body.place or body.everything or body.compare_id or body.point):
        raise Problem(
            422,
            "place, everything, compare_id, point and limits need model_id.",
            "Give model_id, or leave them out.",
        )
    other = None
    if body.compare_id:
        other = {"id": body.compare_id, "file": str(here.jobs.model_file(body.compare_id))}
    order = {
        "place": body.place,
        "everything": body.everything,
        "compare": other,
        "point": body.point or None,
        "limits": None if limits is None else asdict(limits),
    }
    return here.jobs.add("validation", readings | {"model": model, "order": order})


def create_sweeps(here: Service, body: SweepsAsked) -> dict[str, Any]:
    """Analyse the joints that were turned alone: tangential error, reversal, axis and deviation from the circle."""
    return here.jobs.add("sweeps", _readings_of(here, body.dataset_id) | {"level": body.level or None})


def create_selection(here: Service, body: SelectionAsked) -> dict[str, Any]:
    """Choose calibration poses; nothing moves. `result.poses_deg` goes into a block with `select = "list"`."""
    order = {
        "count": body.count,
        "candidates": body.candidates,
        "groups": body.groups,
        "targets": body.targets or None,
        "offset_deg": body.offset_deg,
        "share": body.share,
        "wanted_u": body.wanted_u_mm or None,
        "seed": body.seed,
    }
    return here.jobs.add("selection", {"cell": here.cell.source, "order": order}, _type_file(body.prior))


def create_placements(here: Service, body: PlacementsAsked) -> dict[str, Any]:
    """Search where the base balls should be, so that the arm reaches most stances; nothing moves."""
    order = PlacementRequest.of(body.model_dump())
    wanted_of(order)
    return here.jobs.add("placement", {"cell": here.cell.source, "order": asdict(order)})


def _baseline(here: Service, body: BaselineReference) -> tuple[str, bytes]:
    """The id and the document of the model that is judged by. Raises Problem 404, DataError."""
    if body.model_id:
        return body.model_id, here.jobs.model_file(body.model_id).read_bytes()
    content = here.history.ask(history_calls.content, body.model_document)
    if content is None:
        raise not_found("document", body.model_document)
    return body.model_document, content


def _readings(here: Service, body: ReadingsReference) -> dict[str, Any]:
    """The data set to judge; that of a run is made of its readings up to now. Raises Problem 404, RecordError."""
    if body.dataset_id:
        return here.datasets.get(body.dataset_id)
    here.book.get(body.run_id)  # a dry run has none
    return here.workers.call(here.datasets.export, [here.book.path(body.run_id)], "", None)


def _watch(here: Service, kind: str, baseline: tuple[str, bytes], asked: dict[str, Any]) -> dict[str, Any]:
    own, content = baseline
    sha256 = hashlib.sha256(content).hexdigest()  # by which a history knows it
    file = f"{sha256[:12]}.json"  # its name in verdicts: the same for the same model, however it was named
    about = {"id": own, "sha256": sha256, "file": file}
    return here.jobs.add(kind, asked | {"baseline": about}, {file: content})


def _judge(here: Service, kind: str, body: ReadingsReference, more: dict[str, Any]) -> dict[str, Any]:
    baseline = _baseline(here, body)  # refused before a run is made a data set
    order = {
        "rate": body.false_alarms,
        "missing_allowed": body.allow_missing,
        "running_s": body.running_s if body.running_s >= 0.0 else None,
        **more,
    }
    own = _readings(here, body)["id"]
    return _watch(here, kind, baseline, _readings_of(here, own) | {"order": order})


def create_watch_plan(here: Service, body: WatchPlanAsked) -> dict[str, Any]:
    """Choose check poses in the cell of this service, and say what they will show; nothing moves.

    `result.campaign` visits them: POST it to /runs, then judge the run with POST /watches. Balls that a person touches
    are planned with 'truepose watch plan --touch'.
    """
    order = {
        "poses": body.poses,
        "candidates": body.candidates,
        "targets": body.targets,
        "offset_deg": body.offset_deg,
        "both": not body.one_side,
        "rate": body.false_alarms,
        "seed": body.seed,
        "rounds": body.visits,
        "repeats": body.readings,
        "frame_known": not body.new_frame,
    }
    return _watch(here, "watch_plan", _baseline(here, body), {"cell": here.cell.source, "order": order})


def create_watch(here: Service, body: WatchRequestBody) -> dict[str, Any]:
    """Judge by readings of check poses whether this is still the robot that was calibrated.

    Where a cause is known, GET /models/ID with the id of this job is the updated model; targets are corrected with it
    as with any. The verdict enters the history.
    """
    return _judge(here, "watch", body, {"average": body.average, "frame_known": not body.new_frame})


def create_upkeep(here: Service, body: UpkeepAsked) -> dict[str, Any]:
    """Update how warm the arm is by a few readings, between watches; where anything else has changed, nothing is."""
    return _judge(here, "upkeep", body, {})


@dataclass(frozen=True)
class JobKind:
    """A kind of job: its name, the tags under which OpenAPI lists it, its collection, and the words of its answer.

    operation: the second half of the operation ids. request and begin: None for jobs that are asked for elsewhere.
    listed: the answer with the newest, and what they are. picture: what the drawing of the result shows.
    """

    kind: str
    tags: tuple[Tag, ...]
    collection: str
    operation: str
    shown: type[ResponseBody]
    about: str
    request: type[RequestBody] | None = None
    begin: Begin | None = None
    listed: tuple[type[ResponseBody], str] | None = None
    picture: str = ""


KINDS = (
    JobKind(
        "alignment",
        (Tag.DATA,),
        "alignments",
        "Alignment",
        AlignmentShown,
        "An alignment{} Its result is that of `align --json`.",
        picture="The speeds before and after, and the error by speed.",
    ),
    JobKind(
        "identification",
        (Tag.DIAGNOSE,),
        "identifications",
        "Identification",
        IdentificationShown,
        "An identification{}",
        ToIdentify,
        create_identification,
    ),
    JobKind(
        "diagnosis",
        (Tag.DIAGNOSE, Tag.CORE),
        "diagnoses",
        "Diagnosis",
        DiagnosisShown,
        "A diagnosis{}",
        ToDiagnose,
        create_diagnosis,
    ),
    JobKind(
        "regression",
        (Tag.DIAGNOSE,),
        "regressions",
        "Regression",
        RegressionShown,
        "A regression{} Its result is that of `regress --json`.",
        RegressionAsked,
        create_regression,
    ),
    JobKind(
        "validation",
        (Tag.VERIFY,),
        "validations",
        "Validation",
        ValidationShown,
        "A validation{}",
        ValidationAsked,
        create_validation,
    ),
    JobKind(
        "sweeps",
        (Tag.DIAGNOSE,),
        "sweeps",
        "Sweeps",
        SweepsShown,
        "An analysis of sweeps{} Its result is that of `sweeps --json`.",
        SweepsAsked,
        create_sweeps,
        picture="The tangential error of every joint over its angle, up and down.",
    ),
    JobKind(
        "selection",
        (Tag.PREPARE,),
        "selections",
        "Selection",
        SelectionShown,
        "A selection{}",
        SelectionAsked,
        create_selection,
    ),
    JobKind(
        "placement",
        (Tag.PREPARE,),
        "placements",
        "Placements",
        PlacementsShown,
        "A search{} Its result is that of `plan-ballbar --json`.",
        PlacementsAsked,
        create_placements,
        picture="The placements that were found, from above and from the side.",
    ),
    JobKind(
        "watch_plan",
        (Tag.ROBOTS,),
        "watch-plans",
        "WatchPlan",
        WatchPlanShown,
        "A plan of a watch{}",
        WatchPlanAsked,
        create_watch_plan,
        (
            WatchPlansShown,
            "The newest plans of watches; `baseline.sha256` is the hash of their model in the history.",
        ),
    ),
    JobKind(
        "watch",
        (Tag.ROBOTS,),
        "watches",
        "Watch",
        WatchShown,
        "A watch{}",
        WatchRequestBody,
        create_watch,
        (WatchesShown, "The newest watches that were judged here."),
    ),
    JobKind(
        "upkeep",
        (Tag.ROBOTS,),
        "upkeeps",
        "Upkeep",
        UpkeepShown,
        "An upkeep{}",
        UpkeepAsked,
        create_upkeep,
        (UpkeepsShown, "The newest upkeeps that were made here."),
    ),
)


async def shown(here: Service, kind: str, name: str, wait: int, after: int) -> JSONResponse:
    """Return the document of a job.

    With `wait`, s, the answer comes as soon as its version is beyond `after`. The document is as it was kept: a
    result of an older version is returned unchanged.
    """

    def read() -> dict[str, Any]:
        return here.jobs.document(kind, name)

    what = f"{kind} {name}"
    document = await here.reading(what, read)
    if wait and document["version"] <= after and document["state"] not in ("succeeded", "failed"):
        await here.changed(what, lambda seconds: here.jobs.wait(kind, name, after, seconds), after, wait)
        document = await here.reading(what, read)
    return JSONResponse(document)


def _routes(of: JobKind) -> None:
    """Add the routes of a kind of job."""
    path, request, begin = f"/{of.collection}", of.request, of.begin
    tags: list[str | Enum] = [*of.tags]
    words = "".join(f" {letter}" if letter.isupper() else letter for letter in of.operation)

    if begin is not None:

        def create(here: Here, body: Any, idempotency_key: IdempotencyKey = "") -> JSONResponse:
            def work() -> JSONResponse:
                return begun(path_of(of.collection), begin(here, body))

            return here.keys.once(idempotency_key, (path_of(of.collection), body), work)

        create.__annotations__["body"] = request
        router.add_api_route(
            path,
            create,
            methods=["POST"],
            operation_id=f"create{of.operation}",
            status_code=202,
            response_model=of.shown,
            tags=tags,
            summary=f"Create{words}",
            description=inspect.cleandoc(begin.__doc__ or ""),
        )
    if of.listed is not None:
        answer, about = of.listed
        (member,) = answer.model_fields

        async def newest(here: Here, page: NewestPage) -> Response:
            return await here.listed(
                member,
                page,
                lambda: here.jobs.ids(of.kind),
                lambda name: here.jobs.document(of.kind, name),
            )

        plural = f"{words}es" if words.endswith("ch") else f"{words}s"
        router.add_api_route(
            path,
            newest,
            operation_id=f"list{plural.replace(' ', '')}",
            response_model=answer,
            responses=LINKED,
            tags=tags,
            summary=f"List{plural}",
            description=about,
        )

    async def get(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
        return await shown(here, of.kind, job_id, wait, after)

    router.add_api_route(
        f"{path}/{{job_id}}",
        get,
        operation_id=f"get{of.operation}",
        response_model=of.shown,
        tags=tags,
        summary=f"Get{words}",
        description=of.about.format("; with `wait`, as soon as its version is beyond `after`."),
    )

    if of.picture:

        def picture(here: Here, job_id: JobId) -> Response:
            return Response(here.jobs.picture(job_id), media_type="image/svg+xml", headers=REPORT_HEADERS)

        router.add_api_route(
            f"{path}/{{job_id}}/picture.svg",
            picture,
            operation_id=f"get{of.operation}Picture",
            response_class=Response,
            tags=tags,
            summary="Get Picture",
            description=of.picture,
        )


for _kind in KINDS:
    _routes(_kind)
