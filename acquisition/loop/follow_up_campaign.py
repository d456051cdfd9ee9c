"""A campaign that follows an ambiguous diagnosis: poses that distinguish its rivals.

Candidates are drawn as the poses of every campaign are, clear of table and boxes with their approach points, with short
and long last moves from both sides. `calib.diagnose.follow_up` chooses among them. The campaign file states every
pose; poses that share a target and an approach are one block, since the format states these by block. Angles in deg.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import tomli_w

from acquisition.campaign.campaign import FORMAT, Campaign
from acquisition.campaign.plan import DECIMALS
from acquisition.campaign.poses import draw_poses, too_few
from acquisition.cell.cell import Cell
from calib.data import Conditions
from calib.diagnose import APPROACHES, POSES, SEPARATES, FollowUp, Rivals, later_visits, separating
from calib.errors import DataError
from calib.fit import IdentificationFit
from calib.units import DEG

CANDIDATES = 1500
_SETTINGS: dict[str, Any] = {"settle_s": 4.0, "samples": 100, "retries": 2}


def in_cell(cell: Cell, found: IdentificationFit, rivals: Rivals) -> FollowUp:
    """Choose the poses that separate rivals best among those that the cell can take.

    Raises
    ------
    DataError
        Robot or targets of the data are not those of the cell.
    ConfigError
        Hardly any pose is clear.
    """
    return separating(found, rivals, candidates_in(cell, found))


def candidates_in(cell: Cell, found: IdentificationFit) -> Conditions:
    """Draw visits that the cell can make.

    They have its targets, short and long approaches from both sides, an equal share of each.
    """
    names = _targets(cell, found)
    rng = np.random.default_rng(0)
    low, high = np.array(cell.robot.limits_deg).T
    lengths = [a for a in APPROACHES if np.all(high - low > 2.0 * a / DEG)]
    joints, sides, approach, targets = [], [], [], []
    share = -(-CANDIDATES // max(2 * len(lengths) * len(names), 1))
    for length in lengths:
        for side in (1, -1):
            for name in names:
                drawn = draw_poses(
                    cell,
                    share,
                    rng,
                    -side * length / DEG,
                    both=False,
                    decimals=DECIMALS,
                    targets=(name,),
                    fewest=0,
                )
                joints += [pose.joints_deg for pose in drawn]
                sides += [float(side)] * len(drawn)
                approach += [length] * len(drawn)
                targets += [name] * len(drawn)
    if len(joints) < POSES:
        raise too_few(cell, len(joints), POSES, names)
    units = cell.robot.model.joint_units
    return later_visits(found, np.array(joints) * units, np.array(sides), np.array(approach), targets)


def fits(cell: Cell, found: IdentificationFit) -> bool:
    """Check that robot and targets of the data are those of the cell."""
    known = found.model.targets[found.readings.conditions.series_names[-1]]
    return cell.robot.model.name == found.model.robot.name and set(known) <= set(cell.tool.targets)


def _targets(cell: Cell, found: IdentificationFit) -> list[str]:
    if cell.robot.model.name != found.model.robot.name:
        raise DataError(
            f"has the robot {cell.robot.model.name}, the data are of {found.model.robot.name}.",
            do="Give the cell in which the data were measured.",
            file=f"cell {cell.name}",
        )
    known = found.model.targets[found.readings.conditions.series_names[-1]]
    names = [name for name in cell.tool.targets if name in known]
    if not names:
        raise DataError(
            f"has the targets {', '.join(cell.tool.targets)}, the data have {', '.join(known)}.",
            do="Give the cell in which the data were measured.",
            file=f"cell {cell.name}",
        )
    return names


def campaign_table(follow_up: FollowUp, like: Campaign | None = None) -> dict[str, Any]:
    """Return the table of `campaign.toml` for follow-up poses.

    Settle time, samples and retries are those of `like`.
    """
    settings = (
        _SETTINGS
        if like is None
        else {"settle_s": like.settle_s, "samples": like.samples, "retries": like.retries}
    )
    units = next(iter(follow_up.rivals.values())).model.robot.joint_units
    joints = np.round(follow_up.joints / units, DECIMALS).tolist()
    offsets = np.round(-follow_up.sides * follow_up.approach / DEG, DECIMALS).tolist()
    blocks: dict[tuple[str, float], list[list[float]]] = {}
    for pose, offset, target in zip(joints, offsets, follow_up.targets, strict=True):
        blocks.setdefault((target, offset), []).append(pose)
    return {
        "format": FORMAT,
        "name": "follow-up",
        **settings,
        "block": [
            {
                "kind": "poses",
                "set": "calibration",
                "select": "list",
                "targets": [target],
                "approach": {"offset_deg": offset, "sides": "one"},
                "joints_deg": poses,
            }
            for (target, offset), poses in sorted(blocks.items())
        ],
    }


def campaign_text(follow_up: FollowUp, cell: Cell | None = None) -> str:
    """Return the text of `campaign.toml` for follow-up poses.

    Comments state which rivals the poses are expected to distinguish and which no pose can. `cell` is the cell for
    which the poses were chosen; None if only the robot's own limits were known.
    """
    table = campaign_table(follow_up)
    comments = [
        "Follow-up of an ambiguous diagnosis: poses that distinguish its rivals.",
        *expectations(follow_up),
        *follow_up.procedures,
        f"Chosen within the cell {cell.name}."
        if cell is not None
        else "Chosen within the robot's own joint limits; table and boxes of no cell were looked at.",
    ]
    lines = [f"# {comment}" for comment in comments]
    lines += ["", tomli_w.dumps({key: value for key, value in table.items() if key != "block"})]
    for block in table["block"]:
        *given, poses = block.items()
        # one pose per line, which a writer of TOML would spread over eight
        lines += ["[[block]]", *(f"{key} = {_inline(value)}" for key, value in given)]
        lines += ["joints_deg = [", *(f"    {_inline(pose)}," for pose in poses[1]), "]", ""]
    return "\n".join(lines)


def _inline(value: Any) -> str:
    """Format a TOML value on one line: text, numbers, lists and tables of them."""
    if isinstance(value, list):
        return f"[{', '.join(_inline(each) for each in value)}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_inline(each)}' for key, each in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


def expectations(follow_up: FollowUp) -> list[str]:
    """State how well the poses are expected to distinguish each pair, one sentence per pair."""
    return [
        f"{label} from {rival}: expected squared distance {square:.0f}, "
        + ("which settles it." if square >= SEPARATES else f"short of the {SEPARATES:g} that settle it.")
        for (label, rival), square in follow_up.separations.items()
    ]
