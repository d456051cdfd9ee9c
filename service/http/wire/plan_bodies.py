"""The answers about plans and scenes, as OpenAPI describes them. Lengths mm, world frame; angles deg; times s."""

from __future__ import annotations

from typing import Any

from service.http.wire.bodies import Answered


class PlannedShown(Answered):
    """One planned reading. `expected_mm`: where the nominal robot has its target; null for a nest."""

    id: int | None
    target: str
    base_target: str | None
    status: str
    expected_mm: list[float] | None


class VisitShown(Answered):
    """The robot at rest in one pose once. `seconds`: what its way, settling and readings take."""

    number: int
    name: str
    kind: str
    set: str
    joints_deg: list[float]
    seconds: float | None
    readings: list[PlannedShown]


class PlanShown(Answered):
    """A plan. `way_mm`: the way of the first target of the tool; `detours`: over home, null where nobody looked;
    `noise_mm`: by how much two readings of one target may differ, k = 2; `expected_within_mm`: beyond it a reading is
    taken for another target.
    """

    format: str
    visits: list[VisitShown]
    way_mm: list[list[float]]
    detours: int | None
    seconds: float
    noise_mm: float | None = None
    expected_within_mm: float | None = None


class UShown(Answered):
    """Expanded uncertainty of predicted positions over the joint limits of the cell, k = 2, mm."""

    median: float
    p95: float
    max: float


class PriceShown(Answered):
    """The price of a visit. `u_mm`: as planned, also with it measured again; null where too little is measured."""

    format: str
    visit: int
    name: str
    set: str
    seconds: float
    coverage_factor: int
    u_mm: UShown | None
    u_without_mm: UShown | None


class ArrowShown(Answered):
    """A reading with its error, measured less predicted: by the nominal robot in its place, and by the model."""

    reading: str
    at_mm: list[float]
    nominal_mm: list[float]
    model_mm: list[float]


class ArrowsShown(Answered):
    """Errors in space. `readings`: of how many these are a draw; `held_out`: nothing was fitted to them."""

    format: str
    held_out: bool
    readings: int
    arrows: list[ArrowShown]


class ResultShown(Answered):
    """What all results have: those of jobs have the members of a job besides, those of loops the members of a loop."""

    id: str
    kind: str
    state: str
    version: int
    created_utc: str
    result: dict[str, Any] | None
    problem: dict[str, Any] | None
    report: str | None


class SceneShown(Answered):
    """A cell as a picture needs it."""

    format: str
    joints_deg: list[float]
    limits_deg: list[list[float]]
    capsules: list[dict[str, Any]]
    obstacles: list[dict[str, Any]]
    nests_mm: dict[str, list[float]]
    targets_mm: dict[str, list[float]]
    tool_mm: dict[str, list[float]]
    station_mm: list[float] | None
    bar_mm: float | None
    one_smr: bool
