"""The bodies of searches of placements of a ballbar's base balls: what is asked, and the result."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from service.http.wire.bodies.told import Answered, Body, Names, Point, told
from service.results.cell.placements import TOGETHER, Order

Number = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]


def _range(words: str, default: tuple[float, float, float]) -> Any:
    return told(f"{words}: lowest, highest, step.", list(default), min_length=3, max_length=3)


class PlacementsAsked(Body):
    """The shifts and turns of the base balls to try; the options of `truepose plan-ballbar`."""

    x: Annotated[list[Number], _range("Shift along x of the world, mm", Order.x)] = Field(
        default_factory=lambda: list(Order.x)
    )
    y: Annotated[list[Number], _range("Shift along y of the world, mm", Order.y)] = Field(
        default_factory=lambda: list(Order.y)
    )
    z: Annotated[list[Number], _range("Shift along z of the world, mm", Order.z)] = Field(
        default_factory=lambda: list(Order.z)
    )
    turn: Annotated[list[Number], _range("Turn about the vertical, deg", Order.turn)] = Field(
        default_factory=lambda: list(Order.turn)
    )
    base: Annotated[
        list[Annotated[str, Field(max_length=100)]] | None,
        told(
            "Three or four balls of the cell; left out: its first three.",
            ["B1", "B2", "B3"],
            min_length=3,
            max_length=4,
        ),
    ] = None
    zone: Annotated[
        list[Number] | None,
        told(
            "Centre x, y, z and radius of a sphere, mm, in which the predicted U ranks; left out: poses do.",
            [300.0, 0.0, 300.0, 200.0],
            min_length=4,
            max_length=4,
        ),
    ] = None
    together: Annotated[
        int,
        told(
            "Number of placements of one plan, which complete each other in the zone.", 1, ge=1, le=TOGETHER
        ),
    ] = 1
    offset_deg: Annotated[
        float,
        told("From how far below every joint arrives, deg.", Order.offset_deg, ge=0.1, le=30.0),
    ] = Order.offset_deg
    show: Annotated[
        int, told("Number of placements that are proven and listed.", Order.show, ge=1, le=50)
    ] = Order.show


class Placed(Answered):
    """One placement of the base balls."""

    shift_mm: Annotated[Point, told("Shift from the cell file, mm.", [50.0, 0.0, 0.0])]
    turn_deg: Annotated[float, told("Turn about the vertical, deg.", 15.0)]
    nests_mm: Annotated[dict[str, Point], told("The balls there, world, mm.", {"B1": [350.0, 0.0, 20.0]})]
    poses: Annotated[int, told("Number of stances that the arm reaches.", 61)]
    configurations: Annotated[int, told("Number of configurations in which it does.", 124)]
    by_branch: Annotated[dict[str, int], told("Number of them by branch of the arm.", {"front/up": 46})]
    max_u_mm: Annotated[float | None, told("Largest predicted U (k = 2) in the zone, mm.", 0.021)]


class PlacementsResult(Answered):
    """The result of a search (`truepose-placements/1`)."""

    format: Annotated[Literal["truepose-placements/1"], told("The format.", "truepose-placements/1")]
    cell: Annotated[str, told("Name of the cell.", "lrmate-ballbar")]
    robot: Annotated[str, told("Name of the robot.", "fanuc-lrmate200ic")]
    base: Annotated[Names, told("The balls.", ["B1", "B2", "B3"])]
    stances: Annotated[int, told("Number of stances of the legs.", 144)]
    placements: Annotated[int, told("Number of placements that were tried.", 5832)]
    zone_mm: Annotated[list[float] | None, told("The zone, mm, where one was given.", None)]
    best: Annotated[list[Placed], told("The best, first.", [])]
    plan: Annotated[list[Placed], told("Those that complete each other, in order.", [])]


class Progress(Answered):
    """How far a search is."""

    done: Annotated[int, told("Number of placements looked at.", 1200)]
    total: Annotated[int, told("Number of placements in all.", 5832)]
