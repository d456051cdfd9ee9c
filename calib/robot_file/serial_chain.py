"""Serial chain between two links of a joint tree, with fixed joints merged and mimics named."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.errors import DataError
from calib.robot_file.urdf import METRE, MOVING, Mimic, Urdf, UrdfJoint
from calib.units import DEG

MOST_JOINTS = 20
_FULL_TURN = 360.0 * DEG
HELD = 0.001  # deg or mm: limits of the own part of a joint that follows another


@dataclass(frozen=True)
class SerialChain:
    """N joints that move, and the constant frames between them.

    Attributes
    ----------
    names, slides : tuple
        Name of each joint, and whether it slides.
    origins : array of shape (N, 4, 4)
        From the joint before (the first from the base link) to each joint's frame, mm.
    axes : array of shape (N, 3)
        Axis of each joint in its frame, of length 1.
    tip : array of shape (4, 4)
        Frame behind the last joint.
    limits : array of shape (N, 2)
        Limits, rad or mm.
    follows : dict
        By number (0-based) of a joint: the number of the joint that it follows, and its mimic.
    masses : tuple
        Link (1-based), kg and centre (3,) in the joint's frame, mm.
    remarks : tuple of str
        Facts that the user must know.
    """

    base: str
    end: str
    names: tuple[str, ...]
    slides: tuple[bool, ...]
    origins: Array
    axes: Array
    tip: Array
    limits: Array
    follows: dict[int, tuple[int, Mimic]]
    masses: tuple[tuple[int, float, Array], ...]
    remarks: tuple[str, ...]

    def forward(self, joints: Array) -> Array:
        """Compute the poses of the tip in the base link, shape (n, 4, 4).

        `joints` (n, N) are in rad or mm.
        """
        pose = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
        for k, (origin, axis) in enumerate(zip(self.origins, self.axes, strict=True)):
            move = np.broadcast_to(np.eye(4), (len(joints), 4, 4)).copy()
            if self.slides[k]:
                move[:, :3, 3] = joints[:, k, None] * axis
            else:
                move[:, :3, :3] = Rotation.from_rotvec(joints[:, k, None] * axis).as_matrix()
            pose = pose @ origin @ move
        return pose @ self.tip

    def coupled(self) -> NDArray[np.float64] | None:
        """Compute the matrix (N, N) from controller to model joints, deg or mm.

        Returns None without mimic joints. A joint that follows another has a separate column, which
        stays 0: the remainder after its mimic is subtracted.
        """
        if not self.follows:
            return None
        matrix = np.eye(len(self.names))
        for k, (source, mimic) in self.follows.items():
            matrix[k, source] = mimic.multiplier * self._shown(k) / self._shown(source)
        return matrix

    def offsets(self) -> Array:
        """Compute the positions of mimic joints when the joint they follow is at 0, (N,), deg or mm."""
        out = np.zeros(len(self.names))
        for k, (_, mimic) in self.follows.items():
            out[k] = mimic.offset * self._shown(k)
        return out

    def _shown(self, k: int) -> float:
        """Return the number of deg or mm that is one rad or m of joint k."""
        return METRE if self.slides[k] else 1.0 / DEG


def chain_of(urdf: Urdf, base: str | None = None, tip: str | None = None) -> SerialChain:
    """Extract the chain from link `base` to link `tip` of a joint tree.

    By default `base` is the link that carries all, and `tip` the only end that moves.

    Raises
    ------
    DataError
        The tree has several ends, and the error names the choices; or a joint cannot be part of a chain.
    """
    for option, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            raise DataError(
                f"there is no link '{link}'.",
                do=f"Use one of {_some(sorted(urdf.links))}.",
                file=urdf.path,
                key=option,
            )
    base = base or _root(urdf)
    path = _path(urdf, base, tip or _end(urdf, base))
    moving = [joint for joint in path if joint.kind in MOVING]
    for joint in path:
        if joint.kind in ("floating", "planar"):
            raise DataError(
                f"is {joint.kind}: it has several freedoms.",
                do="Begin behind it with --base, or make it fixed.",
                file=urdf.path,
                key=f"joint {joint.name}",
            )
    if not 1 <= len(moving) <= MOST_JOINTS:
        raise DataError(
            f"has {len(moving)} joints that move between the two links.",
            do=f"Choose --base and --tip with 1 to {MOST_JOINTS} between them.",
            file=urdf.path,
        )
    origins, masses, here, link, aside = [], [], np.eye(4), 0, {}
    beside = _beside(urdf, path)
    for joint in path:
        here = here @ joint.origin
        if joint.kind in MOVING:
            origins.append(here)
            here, link = np.eye(4), link + 1
        if link:
            masses += [(link, *found) for found in _rigid(urdf, joint.child, here, beside, aside)]
    limits, remarks = zip(*(_limits(joint) for joint in moving), strict=True)
    weightless = [] if not masses else sorted({*range(1, link + 1)} - {at for at, *_ in masses})
    chain = SerialChain(
        base=path[0].parent,
        end=path[-1].child,
        names=tuple(joint.name for joint in moving),
        slides=tuple(joint.kind == "prismatic" for joint in moving),
        origins=np.stack(origins),
        axes=np.stack([joint.axis for joint in moving]),
        tip=here,
        limits=np.array(limits),
        follows=_follows(urdf, moving),
        masses=tuple(masses),
        remarks=(
            *urdf.remarks,
            *(remark for remark in remarks if remark),
            *(
                f"What joint {name} carries ({kg:g} kg) is not in the masses, because it moves on its own: add it to "
                "[[loads]] where it stands."
                for name, kg in aside.items()
            ),
            *(
                f"Nothing that joint {moving[at - 1].name} carries, as far as the next joint, has a mass: add it to "
                "[[loads]], or gravity is too small."
                for at in weightless
            ),
        ),
    )
    return _with_mimic(chain)


def _root(urdf: Urdf) -> str:
    if len(urdf.roots) == 1:
        return urdf.roots[0]
    raise DataError(
        f"has {len(urdf.roots)} links that no joint carries ({', '.join(urdf.roots[:5])}).",
        do="Choose --base and --tip; or let one link carry all others.",
        file=urdf.path,
    )


def _path(urdf: Urdf, base: str, tip: str) -> list[UrdfJoint]:
    path: dict[str, UrdfJoint] = {}  # by the link that is carried
    link = tip
    while link != base:
        if link not in urdf.joints:
            raise DataError(
                f"'{tip}' is not carried by '{base}'.",
                do="Choose --base and --tip along one branch, from the foot to the tool.",
                file=urdf.path,
                key="--tip",
            )
        joint = urdf.joints[link]
        if joint.refused is not None:
            raise joint.refused
        if link in path:
            raise DataError(
                f"carries the link '{link}', which carries it in turn.",
                do="Let one link carry all others, directly or over others.",
                file=urdf.path,
                key=f"joint {joint.name}",
            )
        path[link] = joint
        link = joint.parent
    if not path:
        raise DataError("is the base.", do="Choose another link.", file=urdf.path, key="--tip")
    return [*path.values()][::-1]


def _beside(urdf: Urdf, path: list[UrdfJoint]) -> dict[str, list[UrdfJoint]]:
    """Link -> the joints on it that are not of the path; none leads back to its base."""
    taken = {path[0].parent, *(joint.child for joint in path)}
    return {
        link: [joint for joint in joints if joint.child not in taken]
        for link, joints in _carried(urdf).items()
    }


def _rigid(
    urdf: Urdf, link: str, frame: Array, beside: dict[str, list[UrdfJoint]], aside: dict[str, float]
) -> list[tuple[float, Array]]:
    """Collect the masses that are fixed to a link: kg and centre (3,), mm.

    `frame` (4, 4) is the link's frame. The masses of branches that move are added to `aside`, kg by joint.

    Raises
    ------
    DataError
        A mass cannot be read or placed.
    """
    out: list[tuple[float, Array]] = []
    ahead: list[tuple[str, Array, DataError | None]] = [(link, frame, None)]
    while ahead:
        link, frame, refused = ahead.pop()
        if (found := urdf.masses.get(link)) is not None:
            if isinstance(found, DataError):
                raise found
            if refused is not None:
                raise refused
            mass, centre = found
            out.append((mass, frame[:3, :3] @ centre + frame[:3, 3]))
        for joint in beside.get(link, ()):
            if joint.kind == "fixed":
                ahead.append((joint.child, frame @ joint.origin, refused or joint.refused))
            elif kg := _kilograms(urdf, joint.child, beside):
                aside[joint.name] = kg
    return out


def _kilograms(urdf: Urdf, link: str, beside: dict[str, list[UrdfJoint]]) -> float:
    """Sum the masses of a branch, without those that cannot be read."""
    total, ahead = 0.0, [link]
    while ahead:
        link = ahead.pop()
        found = urdf.masses.get(link)
        total += found[0] if isinstance(found, tuple) else 0.0
        ahead += [joint.child for joint in beside.get(link, ())]
    return total


def _end(urdf: Urdf, base: str) -> str:
    """Find the link at the end of the only branch of joints that move.

    Raises
    ------
    DataError
        There are several ends, or none.
    """
    parents = {joint.parent for joint in urdf.joints.values()}
    moved = {
        base: False
    }  # link -> whether a joint that moves lies between the base and it; others are not carried
    carried = _carried(urdf)
    ahead = [base]
    while ahead:
        link = ahead.pop()
        for joint in carried.get(link, ()):
            if joint.child in moved:
                continue  # a ring, which a path through it refuses
            moved[joint.child] = moved[link] or joint.kind in MOVING
            ahead.append(joint.child)
    ends = [link for link in urdf.joints if link not in parents and link != base and moved.get(link)]
    if len(ends) < 2 and (refused := [joint.refused for joint in urdf.joints.values() if joint.refused]):
        raise refused[0]  # it may hide the end that was meant
    if len(ends) == 1:
        return ends[0]
    if not ends:
        raise DataError(
            "no joint that moves is carried by the base.", do="Choose --base.", file=urdf.path, key="--tip"
        )
    raise DataError(
        f"has {len(ends)} ends: {_some(sorted(ends))}.",
        do="Choose the link that is the flange: --tip NAME.",
        file=urdf.path,
        key="--tip",
    )


def _carried(urdf: Urdf) -> dict[str, list[UrdfJoint]]:
    """List the joints on each link."""
    out: dict[str, list[UrdfJoint]] = {}
    for joint in urdf.joints.values():
        out.setdefault(joint.parent, []).append(joint)
    return out


def _some(names: list[str]) -> str:
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")


def _limits(joint: UrdfJoint) -> tuple[tuple[float, float], str]:
    """Return the limits of a joint in rad or mm, and a remark on them."""
    if joint.limits is None:
        return (
            (-_FULL_TURN, _FULL_TURN),
            f"Joint {joint.name} is continuous: -360 to 360 deg were written; correct them by the data sheet.",
        )
    unit = METRE if joint.kind == "prismatic" else 1.0
    return (unit * joint.limits[0], unit * joint.limits[1]), ""


def _follows(urdf: Urdf, moving: list[UrdfJoint]) -> dict[int, tuple[int, Mimic]]:
    """Find the independent joint that each mimic joint follows, with the factor.

    Raises
    ------
    DataError
        The relation is not linear in the chain.
    """
    numbers = {joint.name: k for k, joint in enumerate(moving)}
    out = {}
    for k, joint in enumerate(moving):
        if joint.mimic is None:
            continue
        key, mimic, seen = f"joint {joint.name}", joint.mimic, {joint.name}
        while True:
            source = moving[numbers[mimic.joint]] if mimic.joint in numbers else None
            if source is None:
                raise DataError(
                    f"follows the joint '{mimic.joint}', which does not lie between the two links.",
                    do="Choose --base and --tip with both between them, or make it fixed.",
                    file=urdf.path,
                    key=key,
                )
            if source.name in seen:
                raise DataError("follows itself.", do="Correct its <mimic>.", file=urdf.path, key=key)
            if source.mimic is None:
                break
            seen.add(source.name)
            mimic = Mimic(
                source.mimic.joint,
                mimic.multiplier * source.mimic.multiplier,
                mimic.multiplier * source.mimic.offset + mimic.offset,
            )
        out[k] = (numbers[mimic.joint], mimic)
    return out


def _with_mimic(chain: SerialChain) -> SerialChain:
    """Add remarks on mimic joints to a chain: the column of each stays at 0."""
    if not chain.follows:
        return chain
    limits, remarks = chain.limits.copy(), list(chain.remarks)
    for k, (source, mimic) in chain.follows.items():
        limits[k] = (-HELD, HELD) if chain.slides[k] else (-HELD * DEG, HELD * DEG)
        remarks.append(
            f"Joint {chain.names[k]} follows {chain.names[source]} (x {mimic.multiplier:g}): it is in the joint matrix "
            f"'mimic'; its own column stays 0."
        )
    remarks.append('Set joint_coupling = "mimic" in the header of your data and in the cell file.')
    return replace(chain, limits=limits, remarks=tuple(remarks))
