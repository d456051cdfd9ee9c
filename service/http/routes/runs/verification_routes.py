"""Proofs of models that exist: made, looked at, paused, resumed, stopped."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response

from acquisition import LeaseDeadline
from service.http.routes.json_route import JsonRoute
from service.http.routes.runs.run_routes import acceptance, who
from service.http.runs.loops import ENDED
from service.http.state import Here, Service
from service.http.wire.bodies import NewVerification, ResumeBody, VerificationList, VerificationShown
from service.http.wire.headers import After, IdempotencyKey, LeaseId, VerificationId, Wait
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged

router = APIRouter(route_class=JsonRoute, tags=[Tag.VERIFY])
PROOFS = path_of("verifications")


def _accepted(here: Service, own: str, **more: Any) -> JSONResponse:
    document = here.verifications.document(own) | more
    return reply(202, document, location=f"{PROOFS}/{own}", retry_after=1)


@router.post(
    "/verifications", operation_id="createVerification", status_code=202, response_model=VerificationShown
)
def create_verification(
    here: Here, body: NewVerification, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """Check a proof (`dry_run`, the default), or go through it.

    Going through it moves the robot and needs `Lease-Id`. The nests and one pose are measured; then new poses are
    driven with the corrections of the model and without, and measured. All of it is checked before the first motion.
    Its campaigns are runs, in `runs`. If the service ends meanwhile, it is paused, and can be resumed.
    """

    def work() -> JSONResponse:
        cell, store = here.cell, here.verifications
        if not body.dry_run:
            here.lease.needed(lease_id)
            here.book.need_robot()
        model = here.jobs.model_file(body.model_id) if body.model_id else body.model
        asked = {"model_id": body.model_id, "poses": body.poses, "seed": body.seed}
        status = store.make(cell, model, asked, body.name, dry_run=body.dry_run)
        if body.dry_run:
            return _accepted(here, status.id)

        def begin(lease: LeaseDeadline) -> str:
            return store.start(status, cell, lease)

        try:
            return _accepted(here, here.let_move(lease_id, begin))
        except BaseException:
            if status.id != here.book.lent_to:
                store.forget(status)
            raise

    return here.keys.once(idempotency_key, (PROOFS, body), work)


@router.get(
    "/verifications", operation_id="listVerifications", responses=LINKED, response_model=VerificationList
)
async def list_verifications(here: Here, page: Paged) -> Response:
    """List every proof, newest first."""
    return await here.listed("verifications", page, here.verifications.ids, here.verifications.document)


@router.get(
    "/verifications/{verification_id}", operation_id="getVerification", response_model=VerificationShown
)
async def get_verification(
    here: Here, verification_id: VerificationId, wait: Wait = 0, after: After = 0
) -> dict[str, Any]:
    """Return a proof.

    With `wait`, the answer comes as soon as its version is beyond `after` or nothing can happen to it any more.
    """
    what = f"verification {verification_id}"

    def read() -> dict[str, Any]:
        return here.verifications.document(verification_id)

    document = await here.reading(what, read)
    if wait and document["version"] <= after and document["state"] not in {state.value for state in ENDED}:
        await here.changed(
            what, lambda seconds: here.verifications.wait(verification_id, after, seconds), after, wait
        )
        document = await here.reading(what, read)
    return document


@router.post(
    "/verifications/{verification_id}/pause",
    operation_id="pauseVerification",
    status_code=202,
    response_model=VerificationShown,
)
async def pause_verification(here: Here, verification_id: VerificationId) -> JSONResponse:
    """Pause a proof after the current reading, or between two campaigns after the current step."""

    def work() -> JSONResponse:
        here.verifications.pause(verification_id, by=who(here))
        return _accepted(here, verification_id)

    return await here.order(verification_id, work)


@router.post(
    "/verifications/{verification_id}/resume",
    operation_id="resumeVerification",
    status_code=202,
    response_model=VerificationShown,
)
def resume_verification(
    here: Here,
    verification_id: VerificationId,
    body: ResumeBody,
    idempotency_key: IdempotencyKey = "",
    lease_id: LeaseId = "",
) -> JSONResponse:
    """Continue a proof; the robot moves, so this needs `Lease-Id`.

    It continues from its records after a restart of the service, in the same cell with the same devices. Where the
    model follows time or temperature, a pose that the pause has caught is corrected and checked again. With another
    robot or instrument than before only by its serial number, and for a reason.
    """

    def work() -> JSONResponse:
        here.verifications.document(verification_id)
        here.let_move(
            lease_id,
            lambda lease: here.verifications.resume(
                verification_id, here.cell, lease, acceptance(body, lease.owner)
            ),
        )
        return _accepted(here, verification_id)

    return here.keys.once(idempotency_key, (f"{PROOFS}/{verification_id}/resume", body), work)


@router.post(
    "/verifications/{verification_id}/stop",
    operation_id="stopVerification",
    status_code=202,
    response_model=VerificationShown,
)
async def stop_verification(here: Here, verification_id: VerificationId) -> JSONResponse:
    """Halt the robot now and end the proof. Needs no lease.

    `problems` lists the devices that could not be stopped. The answer comes when the robot has the order, which may
    be a moment before the proof has ended.
    """

    def work() -> JSONResponse:
        problems = here.verifications.stop(verification_id, by=who(here))
        return _accepted(here, verification_id, problems=[problem.as_dict() for problem in problems])

    return await here.order(verification_id, work, stops=True)
