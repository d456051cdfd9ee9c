"""The refusals of the book of runs: what cannot be done now, and what to do."""

from __future__ import annotations

from service.http.runs.execution import RobotThread
from service.http.wire.problems import Problem


def dry() -> Problem:
    """Return the problem of an order to a dry run."""
    return Problem(409, "This was a dry run: nothing moves.", "Start it with dry_run = false.", code=8103)


def other_cell() -> Problem:
    """Return the problem of a run with another cell file.

    Each run has the addresses, limits and boxes of its own cell, not of the current one.
    """
    return Problem(
        409,
        "The run was begun with another cell file.",
        "Start the service with the cell file of the run, or use 'truepose campaign resume'.",
        code=8109,
    )


def other_devices(*, simulated: bool) -> Problem:
    """Return the problem of a run that was measured on devices of the other kind.

    `simulated` says whether they were simulated.
    """
    return Problem(
        409,
        f"The run was measured on {'simulated' if simulated else 'real'} devices, which this service does not use.",
        f"Start the service {'with' if simulated else 'without'} --simulate.",
        code=8104,
    )


def busy(execution: RobotThread) -> Problem:
    """Return the problem of a busy robot, with the ids of its run and loop."""
    ids = {"run_id": execution.run_id, f"{execution.kind}_id": execution.loop_id}
    can_pause = not execution.loop_id and not execution.examines
    return Problem(
        409,
        f"The robot is busy with {execution.what}.",
        "Wait until that has ended, or pause or stop it."
        if can_pause
        else "Wait until that has ended, or stop it.",
        code=8105,
        headers={"Retry-After": "5"},
        **{name: value for name, value in ids.items() if value},
    )


def in_use() -> Problem:
    """Return the problem of deleting a run that uses the robot."""
    return Problem(409, "The run uses the robot.", "Stop it before it is deleted.", code=8105)
