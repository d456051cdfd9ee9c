"""Hypotheses about miscounted joints of a data set: signs, zeros, order, units, couplings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, combinations, islice, product

import numpy as np

from calib.array import Array
from calib.data.hypotheses import Hypothesis, InterpretedReadings, JointCounting
from calib.units import DEG

# Zeros that are off by a quarter or a half turn, and what has to be added
_OFF = {"90": ((90.0, "+90"), (-90.0, "-90")), "180": ((180.0, "180"),)}
_MOST_DIRECTIONS = 247  # all of eight joints; a robot may have 20, and a million choices of them


def of_joints(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
    """Yield hypotheses about the counting of joints.

    A joint may turn in the other direction, have a zero that is off by a quarter or half turn, be in
    radians, or be in another's column. It may also be counted with the joint before it (Fanuc: joint 3
    from the horizontal).
    """
    robot, last = meaning.robot, meaning.angles.shape[1]
    plain = JointCounting(np.eye(last), np.zeros(last))

    def counted(what: str, do: str, key: str, counting: JointCounting) -> Hypothesis:
        return Hypothesis(what, do, "data", key, counting.of(meaning), counting)

    everything = JointCounting(
        np.diag([1.0 / DEG if unit == "deg" else 1.0 for unit in robot.units]), plain.offset
    )
    whole = counted(
        "all joints are given in radians", "Write the joints in degrees.", robot.joint_columns[0], everything
    )
    # A robot file has no radians: these are in the data.
    yield replace(whole, counting=None)
    if len(set(robot.units)) == 1 and last > 2:
        yield counted(
            "the columns of the joints are in reverse order",
            "Write the joints from the foot to the flange.",
            f"{robot.joint_columns[0]}..{robot.joint_columns[-1]}",
            replace(plain, matrix=plain.matrix[::-1]),
        )
    for k, (axis, name, unit) in enumerate(zip(robot.axes, robot.joint_columns, robot.units, strict=True)):
        joint = f"joint {axis.removeprefix('j')}"
        yield counted(
            f"{joint} {robot.kinds[k]} in the other direction than the robot has it",
            f"Change the sign of the column {name}, or of the joint in the robot file.",
            name,
            replace(plain, matrix=_with(plain.matrix, k, k, -1.0)),
        )
        for turn, ways in _OFF.items() if unit == "deg" else ():
            for off, sign in ways:
                tool = ", or turn the tool targets by it about the flange's axis" if k + 1 == last else ""
                yield counted(
                    f"the zero of {joint} is {turn} deg off",
                    f"Add {sign} to the column {name}, or to theta_deg of link {k + 1} in the robot file{tool}.",
                    name,
                    replace(plain, offset=off * DEG * plain.matrix[k]),
                )
        written, factor, meant = ("radians", 1.0 / DEG, "degrees") if unit == "deg" else ("metres", 1e3, "mm")
        other = counted(
            f"{joint} is given in {written}",
            f"Write the column {name} in {meant}.",
            name,
            replace(plain, matrix=_with(plain.matrix, k, k, factor)),
        )
        yield replace(other, counting=None)
    alike = [
        (one, other) for one, other in combinations(range(last), 2) if robot.units[one] == robot.units[other]
    ]
    names = [axis.removeprefix("j") for axis in robot.axes]
    for one, other in alike:
        order = list(range(last))
        order[one], order[other] = other, one
        columns = robot.joint_columns[one], robot.joint_columns[other]
        yield counted(
            f"joints {names[one]} and {names[other]} are in each other's column",
            f"Swap the columns {columns[0]} and {columns[1]}.",
            ", ".join(columns),
            replace(plain, matrix=plain.matrix[order]),
        )
    for k, following in alike:
        if following != k + 1:
            continue
        for own, share in product((1.0, -1.0), repeat=2):
            its = "minus " * (own < 0.0)
            yield counted(
                f"joint {names[following]} of the robot is {its}the controller's "
                f"{'plus' if share > 0.0 else 'minus'} its joint {names[k]}: the two are coupled",
                f"Use a joint matrix that has {share:g} in row {k + 2}, column {k + 1}"
                + f", and {own:g} in column {k + 2}" * (own < 0.0)
                + ".",
                robot.joint_columns[following],
                replace(plain, matrix=_with(_with(plain.matrix, k + 1, k, share), k + 1, k + 1, own)),
            )


def of_directions(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
    """Yield hypotheses that several joints turn in the other direction, fewer joints first.

    KUKA counts joints 1, 4 and 6 so, and for most arms a mirrored frame has this effect.
    """
    columns = meaning.robot.joint_columns
    names = [axis.removeprefix("j") for axis in meaning.robot.axes]
    sizes = range(2, len(columns) + 1)
    choices = chain.from_iterable(combinations(range(len(columns)), size) for size in sizes)
    for turned in islice(choices, _MOST_DIRECTIONS):
        key = ", ".join(columns[k] for k in turned)
        signs = np.ones(len(columns))
        signs[list(turned)] = -1.0
        counting = JointCounting(np.diag(signs), np.zeros(len(columns)))
        yield Hypothesis(
            f"joints {', '.join(names[k] for k in turned)} move in the other direction than the robot has them",
            f"Change the signs of the columns {key}, or give the robot file a joint matrix that does.",
            "data",
            key,
            counting.of(meaning),
            counting,
        )


def _with(matrix: Array, row: int, column: int, value: float) -> Array:
    out = matrix.copy()
    out[row, column] = value
    return out
