"""Calibration poses chosen in a cell (`truepose-selection/1`), for command line and service."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from acquisition import Cell
from acquisition.campaign import DECIMALS, Pose, draw_poses, setup_of
from calib.errors import DataError
from calib.fit import silent
from calib.prior import TypePrior
from calib.selection import (
    BesideType,
    Candidates,
    Choice,
    Curve,
    beside_type,
    candidates_of,
    choose,
    curve_of,
)
from calib.units import to_display
from service.results.common import DroppedParameterResponse, Joints, Share, Warnings
from service.results.shape import Real, ResponseBody, document_of, told


class ObservabilityResponse(ResponseBody):
    """The observability indices of the scaled columns."""

    O1: Annotated[Real, told("No unit.", 0.9, of="o1")]
    O2: Annotated[Real, told("No unit.", 0.02, of="o2")]
    O3: Annotated[Real, told("No unit.", 0.1, of="o3")]
    O4: Annotated[Real, told("No unit.", 0.002, of="o4")]
    O5: Annotated[Real, told("No unit.", 0.3, of="o5")]


class ExpectedErrorResponse(ResponseBody):
    """The standard error that is expected of a parameter."""

    name: Annotated[str, told("Its name.", "theta2")]
    std: Annotated[Real, told("Its standard error, in `unit`.", 0.0005)]
    unit: Annotated[str, told("The unit of std.", "deg")]


class UncertaintyCurve(ResponseBody):
    """The predicted expanded uncertainty (k = 2) of positions over the number of poses.

    It is that of the worst direction.
    """

    poses: Annotated[list[int], told("Numbers of poses.", [40, 45, 50])]
    max_u_mm: Annotated[list[Real], told("The largest, mm.", [0.21, 0.2, 0.19])]
    mean_u_mm: Annotated[list[Real], told("The mean, mm.", [0.11, 0.1, 0.1])]
    max_u_of_model_mm: Annotated[list[Real], told("The largest of the model alone, mm.", [0.2, 0.19, 0.18])]
    enough: Annotated[int | None, told("From this number of poses on more are hardly worth it.", 45)]
    wanted_u_mm: Annotated[Real, told("What was wanted, mm.", None)]
    reached_with: Annotated[int | None, told("Number of poses that reach it.", None)]


class TypeGainResponse(ResponseBody):
    """The predicted expanded uncertainty with the statistics of the robot's type, over the number of poses."""

    parameters: Annotated[list[str], told("Names of what the type knows.", ["theta2"])]
    poses: Annotated[list[int], told("Numbers of poses.", [40, 45, 50])]
    max_u_mm: Annotated[list[Real], told("The largest, mm.", [0.21, 0.2, 0.19])]
    mean_u_mm: Annotated[list[Real], told("The mean, mm.", [0.11, 0.1, 0.1])]
    u_without_mm: Annotated[Real, told("The largest of the chosen poses without the type, mm.", 0.19)]
    reached_with: Annotated[
        int | None, told("Number of poses that reach it with the type; null: the type saves none.", 32)
    ]


class SelectionResult(ResponseBody):
    """The chosen poses, for a block with `select = "list"`, with their predicted accuracy."""

    format: Annotated[Literal["truepose-selection/1"], told("The format.", "truepose-selection/1")]
    cell: Annotated[str, told("The cell.", "irb120-cell")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    targets: Annotated[list[str], told("Names of targets.", ["T1"])]
    groups: Annotated[list[str], told("What the model will free.", ["base", "geometry"])]
    seed: Annotated[int, told("What everything was drawn from; no unit.", 1)]
    candidates: Annotated[int, told("Number of candidates that were found.", 5000)]
    poses_deg: Annotated[list[Joints], told("The poses, deg: `joints_deg` of a block.", [[12.0, 45.0]])]
    filling: Annotated[list[int], told("Numbers of those that fill the joints' ranges.", [3, 17])]
    observability: Annotated[ObservabilityResponse, told("The indices.", {"O1": 0.9})]
    efficiency: Share
    efficiency_without_filling: Share
    bound_gap: Annotated[Real, told("How sharp the bound is, a ratio.", 1e-4)]
    parameters: Annotated[list[ExpectedErrorResponse], told("Every parameter.", [])]
    dropped: Annotated[
        list[DroppedParameterResponse], told("Parameters that such poses do not determine.", [])
    ]
    uncertainty: Annotated[UncertaintyCurve, told("What more or fewer poses are worth.", {"enough": 45})]
    warnings: Warnings
    prior: Annotated[
        TypeGainResponse | None, told("What the robot's type is worth, if that was given.", None)
    ] = None


@dataclass(frozen=True)
class SelectionRequest:
    """The options of a selection of poses.

    Attributes
    ----------
    groups : tuple of str
        Parameter groups that the model will free.
    targets : tuple of str or None
        Names of targets; None for all of the cell.
    offset_deg : float
        Offset from which the joints arrive, deg.
    share : float
        Largest share of the poses that may fill the ranges of the joints.
    wanted_u : float or None
        Target for the predicted U, mm; None for no target.

    Raises
    ------
    DataError
        The target or the seed is negative.
    """

    count: int
    candidates: int
    groups: tuple[str, ...]
    targets: tuple[str, ...] | None
    offset_deg: float
    share: float
    wanted_u: float | None
    seed: int
    prior: TypePrior | None = None

    def __post_init__(self) -> None:
        for name, value in (("wanted_u", self.wanted_u), ("seed", self.seed)):
            if value is not None and not value >= 0:
                raise DataError(f"is {value:g}.", do="Give 0 or more.", key=name)


@dataclass(frozen=True)
class Selected:
    """The poses that were chosen among candidates, with their predicted accuracy."""

    cell: Cell
    asked: SelectionRequest
    targets: tuple[str, ...]
    candidates: Candidates
    choice: Choice
    curve: Curve
    poses: tuple[Pose, ...]
    of_type: BesideType | None = None

    @staticmethod
    def of(cell: Cell, asked: SelectionRequest, say: Callable[[str], None] = silent) -> Selected:
        """Draw candidates and choose poses among them.

        Raises
        ------
        DataError
            The cell measures distances, a target is not in it, or the prior belongs to another robot.
        ConfigError
            The cell does not offer enough poses.
        """
        if cell.instrument.declared.measures_lengths:
            raise DataError(
                f"the {cell.instrument.name} measures distances; poses are chosen for points.",
                do="Use a block of kind = 'hexapod' in the campaign, it takes every stance that the arm reaches.",
                key="instrument.driver",
            )
        names = _names(asked.targets, cell)
        setup = setup_of(cell, names, list(asked.groups))
        if asked.prior is not None:
            of_robot = [e.label for e in setup.model().effects if e.owner == "robot"]
            asked.prior.refuse_other(setup.robot, asked.prior.coupling, of_robot)
        say(f"drawing {asked.candidates} candidates")
        drawn = draw_poses(
            cell,
            asked.candidates,
            np.random.default_rng(asked.seed),
            asked.offset_deg,
            both=False,
            decimals=DECIMALS,
            targets=names,
            fewest=asked.count,
        )
        say(f"selecting {asked.count} of {len(drawn)}")
        found = candidates_of(setup, cell.robot.model_angles([pose.joints_deg for pose in drawn]))
        choice = choose(setup, found, asked.count, share=asked.share, seed=asked.seed)
        say("predicting the uncertainty")
        curve = curve_of(found, choice.selection)
        of_type = None
        if asked.prior is not None:
            of_type = beside_type(found, choice.selection, curve, asked.prior)
        return Selected(
            cell,
            asked,
            tuple(names),
            found,
            choice,
            curve,
            tuple(drawn[i] for i in choice.selection),
            of_type,
        )

    @property
    def csv(self) -> str:
        """The poses, for a block with `select = "file"`."""
        joints = len(self.poses[0].joints_deg)
        lines = [",".join(["target_id", *(f"j{k + 1}_deg" for k in range(joints))])]
        lines += [
            ",".join([str(i), *(f"{q:.{DECIMALS}f}" for q in pose.joints_deg)])
            for i, pose in enumerate(self.poses, start=1)
        ]
        return "\n".join(lines) + "\n"

    def document(self) -> dict[str, Any]:
        """Build the document of the result."""
        choice, curve, wanted, of_type = self.choice, self.curve, self.asked.wanted_u, self.of_type
        index = {int(i): place for place, i in enumerate(choice.selection, start=1)}
        document = {
            "format": "truepose-selection/1",
            "cell": self.cell.name,
            "robot": self.cell.robot.model.name,
            "targets": self.targets,
            "groups": self.asked.groups,
            "seed": self.asked.seed,
            "candidates": len(self.candidates.joints),
            "poses_deg": [pose.joints_deg for pose in self.poses],
            "filling": [index[i] for i in choice.filling],
            "observability": choice.observability,
            "efficiency": choice.efficiency,
            "efficiency_without_filling": choice.efficiency_core,
            "bound_gap": choice.gap,
            "parameters": [
                {"name": p.name, "std": to_display(float(s), p.unit), "unit": p.unit}
                for p, s in zip(self.candidates.parameters, choice.std, strict=True)
            ],
            "dropped": choice.dropped,
            "uncertainty": {
                "poses": curve.counts,
                "max_u_mm": curve.largest,
                "mean_u_mm": curve.mean,
                "max_u_of_model_mm": curve.of_model,
                "enough": curve.enough(),
                "wanted_u_mm": wanted,
                "reached_with": None if wanted is None else curve.reaches(wanted),
            },
            "warnings": choice.warnings,
        }
        if of_type is not None:
            document["prior"] = {
                "parameters": of_type.known,
                "poses": of_type.curve.counts,
                "max_u_mm": of_type.curve.largest,
                "mean_u_mm": of_type.curve.mean,
                "u_without_mm": of_type.u_mm,
                "reached_with": of_type.reached,
            }
        return document_of(SelectionResult.model_validate(document))


def _names(targets: Sequence[str] | None, cell: Cell) -> list[str]:
    if targets is None:
        return list(cell.tool.targets)
    names = list(dict.fromkeys(targets))
    for name in names:
        if name not in cell.tool.targets:
            raise DataError(
                f"'{name}' is not a target of the cell.",
                do=f"Use {', '.join(cell.tool.targets)}.",
                key="--targets",
            )
    return names
