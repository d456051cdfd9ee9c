"""Simulated C-Track behind its MBP/1 bridge (OCMM).

It has two cameras and reflective targets on base, tool and nests. A camera sees a target that looks at it
within 60 deg, within its range, with no limb of the arm between. The reference body sits on the base in an
unknown pose. Poses are given in its frame, so that moving the cameras changes nothing. There is one body per
tool target (20 reflectors, or 9 if the cell says so) and one per nest (9 reflectors). The frame of a body is
parallel to the flange, and for a nest to the world.

p_reference = R^T (p_world - origin); the noise of an averaged pose is 0.02 mm per axis and 0.05 mrad.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocks.shared.arm_device import ArmDevice
from mocks.shared.at_rest import hidden_by, limbs, state_at_rest, target_frame
from mocks.shared.clock import CellClock
from mocks.shared.mbp import BadRequest, pairs, value
from mocks.shared.mbp_bridge import Fields, MbpBridge
from mocks.shared.tracker_device import tracker_frame
from mocks.world import World
from mocks.world.transforms import Matrix, shift, turn

CAMERA_STREAM, FRAME_STREAM = 30, 31
SEEN_WITHIN_DEG, RANGE_MM, BASELINE_MM = 60.0, 6000.0, 1000.0
POINT_SIGMA_MM, TURN_SIGMA_MRAD = 0.02, 0.05
SINGLE_SIGMA_MM, SINGLE_SIGMA_MRAD = 0.03, 0.1
MIN_VISIBLE = 4
Vector = NDArray[np.float64]


def plate(count: int, facing: Vector) -> tuple[Vector, Vector]:
    """Return the places and normals of reflectors on a small plate.

    Places (count, 3) are in mm; normals (count, 3) all equal the unit vector along `facing`.
    """
    z = facing / np.linalg.norm(facing)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    around = 2.4 * np.arange(count)  # a sunflower: no two distances alike, so that no body is ambiguous
    radius = 12.0 * np.sqrt(np.arange(count) + 0.5)
    places = np.outer(radius * np.cos(around), x) + np.outer(radius * np.sin(around), np.cross(z, x))
    return places, np.tile(z, (count, 1))


def quaternion(rotation: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return the unit quaternion, scalar first, of a rotation matrix (3, 3).

    It is the eigenvector of the largest eigenvalue.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    w, x, y, z = np.linalg.eigh(k)[1][:, -1]
    return float(w), float(x), float(y), float(z)


class CTrackDevice:
    """State of cameras and bodies.

    `covered` counts the hidden reflectors of a body, by its name.
    """

    def __init__(
        self,
        world: World,
        arm: ArmDevice,
        clock: CellClock,
        nests: Mapping[str, Sequence[float]],
        normals: Mapping[str, Sequence[float]],
    ) -> None:
        self.world, self.arm, self.clock = world, arm, clock
        self.nests = {name: np.asarray(p, dtype=float) for name, p in nests.items()}
        self.state = "READY"
        self.covered: dict[str, int] = {}
        self.cameras: Matrix = shift(*world.station)
        self.base_frame = np.eye(4)
        self.base_frame[:3, :3], self.base_frame[:3, 3] = tracker_frame(world.seed, np.array([60.0, 0, 80.0]))
        # Two groups of 12 on either side of the foot: the arm seldom hides both.
        groups = []
        for side in (-220.0, 220.0):
            place = np.array([100.0, side, 40.0])
            sheet, looks = plate(12, world.station - place)
            groups.append((sheet + place, looks))
        self.base_plate = tuple(np.concatenate(each) for each in zip(*groups, strict=True))
        # A tool without declared normals carries reflectors all around: it is seen in any orientation.
        self.plates = {
            name: plate(20, np.asarray(normals[name], dtype=float)) if name in normals else None
            for name in world.targets
        }
        self._rng = np.random.default_rng([world.seed, CAMERA_STREAM])

    def totals(self) -> dict[str, int]:
        """Return the number of reflectors of every body."""
        tool = {name: 9 if sheet is None else len(sheet[0]) for name, sheet in self.plates.items()}
        return {"base": len(self.base_plate[0])} | tool | dict.fromkeys(self.nests, 9)

    def frame(self, name: str) -> Matrix:
        """Return the true pose of a body in the world frame, (4, 4)."""
        if name in self.nests:
            return shift(*self.nests[name])
        return target_frame(self.world, state_at_rest(self.world, self.arm, self.clock), name)

    def to_reference(self, frame: Matrix) -> Matrix:
        """Transform a frame of the world to the frame of the reference body."""
        return np.linalg.inv(self.base_frame) @ frame

    def visible(self, name: str) -> int:
        """Count the reflectors of a body that both cameras see now."""
        ends = limbs(self.world, self.arm)
        if name == "base":
            places, normals = self.base_plate
        elif name in self.nests or self.plates[name] is None:
            return max(0, 9 - self.covered.get(name, 0))
        else:
            sheet, frame = self.plates[name], self.frame(name)
            assert sheet is not None
            places, normals = sheet[0] @ frame[:3, :3].T + frame[:3, 3], sheet[1] @ frame[:3, :3].T
        seen = sum(self._seen(place, normal, ends) for place, normal in zip(places, normals, strict=True))
        return max(0, seen - self.covered.get(name, 0))

    def _seen(self, place: Vector, normal: Vector, ends: list[Vector]) -> bool:
        for side in (-0.5, 0.5):
            eye = self.cameras[:3, 3] + side * BASELINE_MM * self.cameras[:3, 1]
            ray = eye - place
            far = float(np.linalg.norm(ray))
            if far > RANGE_MM or normal @ ray < math.cos(math.radians(SEEN_WITHIN_DEG)) * far:
                return False
            if hidden_by(ends, eye, place):
                return False
        return True

    def average(self, name: str, frames: int) -> tuple[Matrix, Vector, float]:
        """Measure a pose in the frame of the reference body.

        Returns the pose, and the scatter of single frames per axis (mm) and of the rotation (mrad).
        """
        pose = self.to_reference(self.frame(name))
        pose[:3, 3] += self._rng.normal(scale=POINT_SIGMA_MM, size=3)
        pose[:3, :3] = turn(self._rng.normal(scale=1e-3 * TURN_SIGMA_MRAD, size=3))[:3, :3] @ pose[:3, :3]
        if frames == 1:
            return pose, np.zeros(3), 0.0
        share = np.sqrt(self._rng.chisquare(frames - 1, size=4) / (frames - 1))
        return pose, SINGLE_SIGMA_MM * share[:3], float(SINGLE_SIGMA_MRAD * share[3])


class CTrackBridge:
    """Wire side of the C-Track.

    `odd` holds faults of single readings that the back door sets; one MEASURE uses them up.
    """

    def __init__(self, device: CTrackDevice) -> None:
        self.device = device
        self.odd: dict[str, Any] = {}
        self.reference: str | None = None
        self.bridge = MbpBridge(
            device.clock,
            pairs(proto=1, kind="OCMM", vendor="Creaform", model="C-Track-780", serial="C780-001", fw="9.0")
            + " "
            + pairs(bridge="1.0", crc=1, units="mm,deg,C,hPa", sim=1),
            self._state,
            {"MODELS": self._models, "DYNREF": self._reference},
            {"INIT": self._init, "MEASURE": self._measure},
            self._sample,
        )

    def orders(self) -> dict[str, Any]:
        """Return the orders of the back door."""
        return {
            "ctrack": lambda order: setattr(self.device, "state", order["state"]),
            "cover": self._cover,
            "move_cameras": self._move_cameras,
            "odd_pose": lambda order: self.odd.update(order["fields"]),
        }

    def _cover(self, order: dict[str, Any]) -> None:
        """`count` reflectors of `body` are hidden from now on."""
        if order["body"] not in self.device.totals():
            raise ValueError(f"body is one of {', '.join(self.device.totals())}")
        self.device.covered[order["body"]] = int(order["count"])
        if order["count"]:
            self.bridge.event("REFERENCE_LOST" if order["body"] == "base" else "TARGET_LOST")

    def _move_cameras(self, order: dict[str, Any]) -> None:
        self.device.cameras = shift(*order["by_mm"]) @ self.device.cameras

    def _state(self) -> str:
        now = self.device.clock.now()
        state = "BUSY" if self.bridge.busy and self.device.state == "READY" else self.device.state
        return f"state={state} " + pairs(T=round(self.device.world.air_c(now), 2))

    def _sample(self, fields: Fields) -> str:
        """Return one line of a stream: a body in the frame of the reference."""
        name = fields.get("model", "T1")
        if name not in self.device.totals() or self.reference is None:
            raise BadRequest(322, "no such body, or no reference")
        pose = self.device.to_reference(self.device.frame(name))
        x, y, z = (float(v) for v in pose[:3, 3])
        turned = {f"q{i}": v for i, v in enumerate(quaternion(pose[:3, :3]))}
        return pairs(model=name, ref=self.reference, x=x, y=y, z=z, **turned)

    def reboot(self) -> None:
        self.device.state, self.reference = "OFF", None
        self.bridge.reboot()

    def _models(self, fields: Fields) -> str:
        totals = self.device.totals()
        return pairs(n=len(totals), names=",".join(totals), totals=",".join(map(str, totals.values())))

    def _reference(self, fields: Fields) -> str:
        name = fields.get("model", "")
        if name not in self.device.totals():
            raise BadRequest(103, f"no body {name}")
        self.reference = name if fields.get("on") == "1" else None
        return ""

    def _look(self) -> None:
        codes = {"OFF": 201, "WARMING": 202, "ERROR": 201, "ESTOP": 610}
        if self.device.state in codes:
            raise BadRequest(codes[self.device.state], f"cameras are {self.device.state}", retry=True)

    async def _init(self, fields: Fields) -> str:
        if self.device.state == "WARMING":
            raise BadRequest(202, "warming up")
        await self.bridge.wait(20.0, lambda: None)
        if self.device.state == "OFF":
            self.device.state = "READY"
        return ""

    async def _measure(self, fields: Fields) -> str:
        device = self.device
        frames, least = int(value(fields, "frames", 1.0)), int(value(fields, "minvis", 4.0))
        name = fields.get("model", "")
        if frames < 1 or name not in device.totals():
            raise BadRequest(103, f"no body {name}, or wrong number of frames")
        if fields.get("ref") != self.reference or self.reference is None:
            raise BadRequest(322, "that reference is not active", retry=True)
        self._look()
        before = device.arm.joints_deg()
        seen: list[tuple[int, int]] = []

        def look() -> None:
            self._look()
            seen.append((device.visible(name), device.visible("base")))
            if seen[-1][0] < max(least, MIN_VISIBLE):
                raise BadRequest(320, f"{seen[-1][0]} targets of {name} visible", retry=True)
            if seen[-1][1] < MIN_VISIBLE:
                raise BadRequest(322, "reference lost", retry=True)

        look()
        await self.bridge.wait(frames / 29.0, look)
        if device.arm.joints_deg() != before and name not in device.nests:
            raise BadRequest(303, "target moved during averaging", retry=True)
        look()
        pose, scatter, turned = device.average(name, frames)
        return self._reading(
            name, frames, pose, scatter, turned, (min(s[0] for s in seen), min(s[1] for s in seen))
        )

    def _reading(
        self, name: str, frames: int, pose: Matrix, scatter: Vector, turned: float, seen: tuple[int, int]
    ) -> str:
        odd, self.odd = self.odd, {}
        totals = self.device.totals()
        answer: dict[str, object] = {"model": name, "ref": self.reference}
        answer |= {key: float(v) for key, v in zip("xyz", pose[:3, 3], strict=True)}
        answer |= {f"q{i}": v for i, v in enumerate(quaternion(pose[:3, :3]))}
        answer |= {key: round(float(v), 6) for key, v in zip(("sx", "sy", "sz"), scatter, strict=True)}
        answer |= {"srot": round(turned, 6), "rms": 0.02, "visible": seen[0], "total": totals[name]}
        answer |= {"rvisible": seen[1], "rtotal": totals["base"], "frames": frames}
        air_c = self.device.world.air_c(self.device.clock.now())
        answer |= {"t": self.bridge.t(), "age": 0.0, "temp": round(air_c, 2)}
        return pairs(**(answer | odd))
