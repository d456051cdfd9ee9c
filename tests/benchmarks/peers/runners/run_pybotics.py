"""Runner of pybotics: `optimize_accuracy` as in its examples, and a vector residual.

The vector residual has three components per reading. Base pose, the modified DH numbers of links 2 to 6 and the
tool's position are free; it has no beta.
"""
# pyright: reportMissingImports=false

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from case import Case, Predict, answer_cases
from pybotics.geometry import vector_2_matrix
from pybotics.kinematic_chain import MDHKinematicChain
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from pybotics.tool import Tool
from scipy.optimize import least_squares

# What converges does so earlier. With twisted axes the vector residual creeps on for ten times as many, to lengths of
# a hundred metres that make up for the twist.
ITERATIONS = 50


def handler_of(case: Case) -> Any:
    """The handler of the nominal robot."""
    links = np.column_stack([case.alpha, case.a, np.zeros(6), case.d])
    tool = Tool(matrix=vector_2_matrix(np.array([*case.target, 0.0, 0.0, 0.0])))
    robot = Robot(kinematic_chain=MDHKinematicChain(links.ravel()), tool=tool)
    return OptimizationHandler(
        robot,
        kinematic_chain_mask=[False] * 4 + [True] * 20,
        tool_mask=[True] * 3 + [False] * 3,
        world_mask=[True] * 6,
    )


def points(robot: Any, joints: Any) -> Any:
    """Compute the points of a robot, (n, 3)."""
    return np.array([robot.fk(q)[:3, 3] for q in joints])


def vector_residual(vector: Any, handler: Any, joints: Any, measured: Any) -> Any:
    """Compute the components of the errors, (3n,)."""
    handler.apply_optimization_vector(vector)
    return (measured - points(handler.robot, joints)).ravel()


def solver(residual: Callable[..., Any]) -> Callable[[Case], Callable[[], Predict]]:
    """Return a solver that uses one of the residuals."""

    def prepare(case: Case) -> Callable[[], Predict]:
        handler = handler_of(case)

        def solve() -> Predict:
            start = handler.generate_optimization_vector()
            found = least_squares(
                residual, start, args=(handler, case.joints, case.measured), max_nfev=ITERATIONS
            )
            handler.apply_optimization_vector(found.x)
            return lambda joints: points(handler.robot, joints)

        return solve

    return prepare


if __name__ == "__main__":
    answer_cases(
        {"optimize_accuracy": solver(optimize_accuracy), "vector residual": solver(vector_residual)},
        ("pybotics", "scipy", "numpy"),
    )
