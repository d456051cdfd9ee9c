"""The bodies of selections of poses: what is asked, and the result (`truepose-selection/1`)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from calib.data import DEFAULT_GROUPS
from calib.selection import SHARE
from service.http.wire.bodies.results import Dropped, Share, Warnings
from service.http.wire.bodies.told import Answered, Body, Joints, told, told_limit


class SelectionAsked(Body):
    """Which calibration poses to measure in the cell of this service; every member may be left out."""

    count: Annotated[int, told("Number of poses to select.", 50, ge=1, le=2000)] = 50
    candidates: Annotated[int, told("Number of candidates, drawn at random.", 5000, ge=1, le=50_000)] = 5000
    groups: Annotated[
        list[Annotated[str, Field(max_length=100)]],
        told("What the model will free.", list(DEFAULT_GROUPS), max_length=50),
    ] = Field(default_factory=lambda: list(DEFAULT_GROUPS))
    targets: Annotated[
        list[Annotated[str, Field(max_length=100)]],
        told("Names of targets measured at every pose; left out: all of the cell.", ["T1"], max_length=50),
    ] = Field(default_factory=list)
    offset_deg: Annotated[
        float,
        told("From where every joint arrives, deg.", -5.0, ge=-30.0, le=30.0, allow_inf_nan=False),
    ] = -5.0
    share: Annotated[
        float,
        told("Share of the poses that may fill the joints' ranges.", SHARE, ge=0.0, le=1.0),
    ] = SHARE
    wanted_u_mm: Annotated[
        float,
        told_limit("The predicted U that is wanted", 0.1),
    ] = 0.0
    seed: Annotated[int, told("Draws the candidates and the starts; no unit.", 1, ge=0, le=2**53)] = 1


class Observability(Answered):
    """The observability indices of the scaled columns."""

    O1: Annotated[float | None, told("No unit.", 0.9)]
    O2: Annotated[float | None, told("No unit.", 0.02)]
    O3: Annotated[float | None, told("No unit.", 0.1)]
    O4: Annotated[float | None, told("No unit.", 0.002)]
    O5: Annotated[float | None, told("No unit.", 0.3)]


class Expected(Answered):
    """The standard error that is expected of a parameter."""

    name: Annotated[str, told("Its name.", "theta2")]
    std: Annotated[float | None, told("Its standard error, in `unit`.", 0.0005)]
    unit: Annotated[str, told("The unit of std.", "deg")]


class UncertaintyCurve(Answered):
    """The predicted expanded uncertainty of positions over the number of poses, worst direction, k = 2."""

    poses: Annotated[list[int], told("Numbers of poses.", [40, 45, 50])]
    max_u_mm: Annotated[list[float | None], told("The largest, mm.", [0.21, 0.2, 0.19])]
    mean_u_mm: Annotated[list[float | None], told("The mean, mm.", [0.11, 0.1, 0.1])]
    max_u_of_model_mm: Annotated[
        list[float | None], told("The largest of the model alone, mm.", [0.2, 0.19, 0.18])
    ]
    enough: Annotated[int | None, told("From this number of poses on more are hardly worth it.", 45)]
    wanted_u_mm: Annotated[float | None, told("What was wanted, mm.", None)]
    reached_with: Annotated[int | None, told("Number of poses that reach it.", None)]


class SelectionResult(Answered):
    """The poses that were chosen, for a block with `select = "list"`, and what they promise."""

    format: Annotated[Literal["truepose-selection/1"], told("The format.", "truepose-selection/1")]
    cell: Annotated[str, told("The cell.", "irb120-cell")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    targets: Annotated[list[str], told("Names of targets.", ["T1"])]
    groups: Annotated[list[str], told("What the model will free.", ["base", "geometry"])]
    seed: Annotated[int, told("What everything was drawn from; no unit.", 1)]
    candidates: Annotated[int, told("Number of candidates that were found.", 5000)]
    poses_deg: Annotated[list[Joints], told("The poses, deg: `joints_deg` of a block.", [[12.0, 45.0]])]
    filling: Annotated[list[int], told("Numbers of those that fill the joints' ranges.", [3, 17])]
    observability: Annotated[Observability, told("The indices.", {"O1": 0.9})]
    efficiency: Share
    efficiency_without_filling: Share
    bound_gap: Annotated[float | None, told("How sharp the bound is, a ratio.", 1e-4)]
    parameters: Annotated[list[Expected], told("Every parameter.", [])]
    dropped: Annotated[list[Dropped], told("Parameters that such poses do not determine.", [])]
    uncertainty: Annotated[UncertaintyCurve, told("What more or fewer poses are worth.", {"enough": 45})]
    warnings: Warnings
