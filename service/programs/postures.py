"""Postures of the nominal robot at the targets of a program, as its controller finds them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calib.arm import (
    BranchResult,
    Robot,
    inverse_kinematics,
    nearest_branch,
    nearest_turns,
    within_limits,
)
from calib.array import Array
from service.programs.program import ProgramTarget

_NO_POSTURE = "no joint target before it says which posture the arm has: begin with one"


def postures(targets: Sequence[ProgramTarget], robot: Robot, coupling: str) -> tuple[Array, list[str]]:
    """Find the controller angles (n, N), rad, of targets.

    Angles are NaN if they cannot be found. The reasons are sentence parts, '' for a target that was found. Poses
    without a branch are solved nearest to the target before them. A track stays, and seven axes keep their elbow,
    at the values of the joint target before.

    Raises
    ------
    DataError
        There are poses, and the robot has no inverse kinematics here.
    """
    angles = np.full((len(targets), robot.joints), np.nan)
    why = [target.refused for target in targets]
    posed = [i for i, t in enumerate(targets) if t.flange is not None and not t.refused]
    branches: tuple[str, ...] = ()
    solved: dict[int, tuple[Array, tuple[BranchResult, ...]]] = {}
    if posed:
        flange = np.stack([t.flange for t in targets if t.flange is not None and not t.refused])
        taught = _taught_before(targets, robot.joints)[posed]
        solutions = inverse_kinematics(
            robot, flange, seed=robot.model_angles(np.nan_to_num(taught), coupling)
        )
        branches = solutions.branches
        counted = robot.controller_angles(solutions.joints, coupling)
        if robot.joints > 6 or robot.external:
            for i, row in zip(posed, taught, strict=True):
                if not np.all(np.isfinite(row)):
                    why[i] = _NO_POSTURE
        solved = {i: (counted[row], solutions.all_of(row)) for row, i in enumerate(posed)}
    before: Array | None = None
    for i, target in enumerate(targets):
        if why[i] or target.empty:
            continue
        if target.joints is not None:
            angles[i] = target.joints
        elif i in solved:
            angles[i], why[i] = _chosen(target, *solved[i], branches, before, robot)
        if not why[i]:
            before = angles[i]
    return angles, why


def _taught_before(targets: Sequence[ProgramTarget], joints: int) -> Array:
    """Return the last joint target (n, N) at or before each target.

    Joints are as the controller counts them; NaN before the first joint target.
    """
    taught, here = np.full((len(targets), joints), np.nan), np.full(joints, np.nan)
    for i, target in enumerate(targets):
        if target.joints is not None and not target.refused:
            here = np.asarray(target.joints)
        taught[i] = here
    return taught


def _chosen(
    target: ProgramTarget,
    counted: Array,
    reached: tuple[BranchResult, ...],
    branches: tuple[str, ...],
    before: Array | None,
    robot: Robot,
) -> tuple[Array, str]:
    """Return the solution of `counted` (B, N) that the controller takes, or why there is none."""
    nowhere = np.full(robot.joints, np.nan)
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    if target.among:
        return _only_one(target, counted, reached, branches, robot)
    if target.branch is None:
        if before is None:
            return nowhere, _NO_POSTURE
        turned = within_limits(counted, before, lower, upper, slides=robot.slides)
        nearest = int(nearest_branch(turned, before))
        if nearest < 0:
            return nowhere, "it is out of reach, or beyond the joint limits, in every branch"
        return (
            (turned[nearest], "")
            if reached[nearest] is BranchResult.YES
            else (nowhere, reached[nearest].value)
        )
    if target.branch not in branches:
        return nowhere, f"this arm has no branch '{target.branch}', only {', '.join(branches)}"
    branch = branches.index(target.branch)
    solution = counted[branch]
    if reached[branch] is not BranchResult.YES:
        return nowhere, f"{reached[branch]} ({target.branch})"
    # Where the program asks for a turn it is that one, whether within the limits or not: reported after the correction.
    seed = np.zeros(robot.joints)
    for joint, (begin, end) in target.windows.items():
        seed[joint], lower[joint], upper[joint] = 0.5 * (begin + end), -np.inf, np.inf
    turned = nearest_turns(solution, seed, lower, upper, slides=robot.slides)
    if not np.all(np.isfinite(turned)):
        return nowhere, f"it is beyond the joint limits ({target.branch})"
    outside = leaves_window(target, turned)
    return (nowhere, f"its configuration does not fit: {outside}") if outside else (turned, "")


def _only_one(
    target: ProgramTarget,
    counted: Array,
    reached: tuple[BranchResult, ...],
    branches: tuple[str, ...],
    robot: Robot,
) -> tuple[Array, str]:
    """Return the one solution of `counted` (B, N) within the limits that fits every window.

    If there is none, the reason is returned.
    """
    if not set(target.among) <= set(branches):
        return np.full(robot.joints, np.nan), f"this arm has no such posture, only {', '.join(branches)}"
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    seed = np.zeros(robot.joints)
    for joint, (begin, end) in target.windows.items():
        seed[joint] = 0.5 * (begin + end)
    fitting = []
    elbows = np.remainder(counted[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    for branch in target.among:
        k, other = branches.index(branch), branches.index(_other_elbow(branch))
        elbow_fits = target.larger_elbow in (None, bool(elbows[k] > elbows[other]))
        if reached[k] is BranchResult.YES and elbow_fits:
            turned = nearest_turns(counted[k], seed, lower, upper, slides=robot.slides)
            fits = np.all(np.isfinite(turned)) and not leaves_window(target, turned)
            fitting += [turned] if fits else []
    if len(fitting) == 1:
        return fitting[0], ""
    many = "several postures fit" if fitting else "no posture fits"
    return np.full(robot.joints, np.nan), f"{many} the configuration that it asks for"


def _other_elbow(branch: str) -> str:
    side, elbow, wrist = branch.split("/")
    return "/".join((side, {"up": "down", "down": "up"}[elbow], wrist))


def leaves_window(target: ProgramTarget, angles: Array, joints: Collection[int] | None = None) -> str:
    """Return the joint that is outside the turns that the program requires.

    It is a sentence part, '' if there is none. `joints` restricts the check.
    """
    for joint, (begin, end) in target.windows.items():
        if (joints is None or joint in joints) and not begin <= angles[joint] <= end:
            asked = f"{np.degrees(begin):.1f} to {np.degrees(end):.1f}"
            return f"joint {joint + 1} is at {np.degrees(angles[joint]):.2f} deg, asked for is {asked}"
    return ""
