"""Frame of the tool target and torque of gravity for one pose, by 4x4 matrices.

The frame is in the world. `add` holds additions to the nominal robot, slot by slot, in rad and mm. World -> base ->
links 1..6 -> target:

    modified DH   Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d); the first link with the base is
                  T(x, y, z + d_1) Rx Ry Rz(rz) Rz(theta_1)                       (Craig; Hayati; thesis, I.2)
    standard DH   Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), behind T(x, y, z) Rx Ry Rz
    target        T(x, y, z) Rx Ry Rz at the flange

Gravity turns joint i by c_i tau_i, tau_i = z_i . sum over the loads beyond it of (c - o_i) x m g, at nominal
geometry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from functools import lru_cache, reduce
from operator import matmul

import numpy as np

from tests.reference.decimals import Matrix, cross, degrees, identity, shift, turn
from tests.reference.robots import Arm

ZERO = Decimal(0)
Add = Mapping[str, Decimal]


@lru_cache(maxsize=20_000)
def _product(*motions: tuple[str, int, Decimal]) -> Matrix:
    """Multiply elementary motions ("turn" or "shift", axis, amount) to one read-only matrix.

    Zeros are left out.
    """
    kinds = {"turn": turn, "shift": shift}
    out = reduce(matmul, [kinds[kind](axis, amount) for kind, axis, amount in motions if amount], identity(4))
    out.flags.writeable = False
    return out


def _six(add: Add, name: str, z: Decimal = ZERO) -> Matrix:
    """T(x, y, z + `z`) Rx Ry Rz."""
    place = [add.get(f"{name}.{axis}", ZERO) for axis in ("x", "y", "z", "rx", "ry", "rz")]
    place[2] += z
    return _product(*((("shift", "turn")[k // 3], k % 3, place[k]) for k in range(6)))


def _link(arm: Arm, k: int, angle: Decimal, add: Add) -> tuple[Matrix, Matrix]:
    """Compute the matrices of link k up to the axis of its joint and behind it.

    The second one includes the turn itself.
    """
    alpha = degrees(arm.number("alpha", k)) + add.get(f"alpha{k}", ZERO)
    a = arm.number("a", k) + add.get(f"a{k}", ZERO)
    theta = degrees(arm.number("theta", k)) + angle + add.get(f"theta{k}", ZERO)
    d = ZERO if arm.modified and k == 1 else arm.number("d", k) + add.get(f"d{k}", ZERO)
    twist = [("turn", 0, alpha), ("turn", 1, add.get(f"beta{k}", ZERO))]
    if arm.modified:
        return _product(*twist, ("shift", 0, a)), _product(("turn", 2, theta), ("shift", 2, d))
    return identity(4), _product(("turn", 2, theta), ("shift", 2, d), ("shift", 0, a), *twist)


def target_frame(arm: Arm, angles: Sequence[Decimal], add: Add) -> Matrix:
    """Compute the world frame of the target (4, 4) at model angles, rad.

    `add` contains its position as target.x, .y, .z.
    """
    frame = _six(add, "base", arm.number("d", 1) if arm.modified else ZERO)
    for k, angle in enumerate(angles, start=1):
        ahead, behind = _link(arm, k, angle, add)
        frame = frame @ ahead @ behind
    return frame @ _six(add, "target")


def gravity_torques(
    arm: Arm, angles: Sequence[Decimal], loads: Sequence[tuple[int, Decimal, Matrix]]
) -> list[Decimal]:
    """Torque about every joint, N.mm, of loads (link, mass in kg, centre (3,) in its frame, mm)."""
    frame = shift(2, arm.number("d", 1)) if arm.modified else identity(4)
    axes, frames = [], []
    for k, angle in enumerate(angles, start=1):
        ahead, behind = _link(arm, k, angle, {})
        axes.append(frame @ ahead)
        frame = axes[-1] @ behind
        frames.append(frame)
    torques = [ZERO] * len(angles)
    for link, mass, centre in loads:
        place = frames[link - 1][:3, :3] @ centre + frames[link - 1][:3, 3]
        weight = np.array([ZERO, ZERO, Decimal("-9.81") * mass])
        for i in range(link):
            torques[i] += axes[i][:3, 2] @ cross(place - axes[i][:3, 3], weight)
    return torques
