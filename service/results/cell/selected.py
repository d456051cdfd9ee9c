"""Calibration poses chosen in a cell, for the command line and for the jobs of the service (`truepose-selection/1`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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
from service.json_values import finite

FORMAT = "truepose-selection/1"


@dataclass(frozen=True)
class SelectionRequest:
    """The question of a choice of poses. groups: what the model will free; targets: names, None for all of the cell;
    offset_deg: from where joints arrive; share: most of the poses that may fill the joints' ranges; wanted_u: mm, None
    for no wish."""

    count: int
    candidates: int
    groups: tuple[str, ...]
    targets: tuple[str, ...] | None
    offset_deg: float
    share: float
    wanted_u: float | None
    seed: int
    prior: TypePrior | None = None


@dataclass(frozen=True)
class Selected:
    """The poses that were chosen among candidates, and what they promise."""

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
        """Draw and choose. Raises DataError, ConfigError."""
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
        """Document of the result, as JSON has it."""
        choice, curve, o = self.choice, self.curve, self.choice.observability
        index = {int(i): place for place, i in enumerate(choice.selection, start=1)}
        wanted = self.asked.wanted_u
        return finite(
            {
                "format": FORMAT,
                "cell": self.cell.name,
                "robot": self.cell.robot.model.name,
                "targets": list(self.targets),
                "groups": list(self.asked.groups),
                "seed": self.asked.seed,
                "candidates": len(self.candidates.joints),
                "poses_deg": [list(pose.joints_deg) for pose in self.poses],
                "filling": [index[i] for i in choice.filling],
                "observability": {"O1": o.o1, "O2": o.o2, "O3": o.o3, "O4": o.o4, "O5": o.o5},
                "efficiency": choice.efficiency,
                "efficiency_without_filling": choice.efficiency_core,
                "bound_gap": choice.gap,
                "parameters": [
                    {"name": p.name, "std": to_display(float(s), p.unit), "unit": p.unit}
                    for p, s in zip(self.candidates.parameters, choice.std, strict=True)
                ],
                "dropped": [
                    {"name": d.name, "confounded_with": list(d.confounded_with)} for d in choice.dropped
                ],
                "uncertainty": {
                    "poses": curve.counts.tolist(),
                    "max_u_mm": curve.largest.tolist(),
                    "mean_u_mm": curve.mean.tolist(),
                    "max_u_of_model_mm": curve.of_model.tolist(),
                    "enough": curve.enough(),
                    "wanted_u_mm": wanted,
                    "reached_with": None if wanted is None else curve.reaches(wanted),
                },
                "warnings": list(choice.warnings),
                **({} if self.of_type is None else {"prior": _beside(self.of_type)}),
            }
        )


def _beside(of_type: BesideType) -> dict[str, Any]:
    return {
        "parameters": list(of_type.known),
        "poses": of_type.curve.counts.tolist(),
        "max_u_mm": of_type.curve.largest.tolist(),
        "mean_u_mm": of_type.curve.mean.tolist(),
        "u_without_mm": of_type.u_mm,
        "reached_with": of_type.reached,
    }


def _names(targets: Sequence[str] | None, cell: Cell) -> list[str]:
    if targets is None:
        return list(cell.tool.targets)
    names = list(dict.fromkeys(targets))
    for name in names:
        if name not in cell.tool.targets:
            raise DataError(
                f"'{name}' is no target of the cell.",
                do=f"Use {', '.join(cell.tool.targets)}.",
                key="--targets",
            )
    return names
