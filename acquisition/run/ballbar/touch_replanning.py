"""New poses of a ballbar hexapod after the robot has touched the cups of its base.

    touches -> three taught points -> laid over by the measured triangle -> stances of the legs -> joints, checked

If touches and sides disagree by more than the error of a robot, the cup that all disagreements share is named and
touched again. A pose keeps its place in the plan, its legs and its branch. A pose that may not be driven from the
touched cups is left out. Readings that were attempted stay as they were. Source: Nubiola, thesis, section 4.2.
Lengths mm, angles deg.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from acquisition.campaign.blocks.adaptive import AdaptiveBlock, pool_of
from acquisition.campaign.blocks.block import BlockVisit, Joints, rounded
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.campaign.blocks.sphere import SphereBlock
from acquisition.campaign.campaign import Campaign
from acquisition.campaign.plan import Visit, site_of
from acquisition.cell.cell import Cell, with_nests
from acquisition.cell.reach import configurations
from acquisition.errors import CupsDisagree
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.record.touches import Taught, block_of_touches, taught_of
from calib.arm import forward, nearest_branch
from calib.errors import DataError
from drivers.errors import AcquisitionError, ConfigError
from drivers.interfaces import Answer

SAME_POSE_DEG = 15.0  # by which a joint may turn between where a cup was thought to be and where it is
_MEASURED = """
SELECT max(attempt.id) FROM attempt JOIN pose ON pose.id = attempt.pose
WHERE pose.kind = 'nest' AND attempt.status = 'good'
"""
_LAST = "SELECT json_extract(data, '$.readings') FROM event WHERE kind = 'taught' ORDER BY id DESC LIMIT 1"


class Placing:
    """The placing of the base in one execution.

    `consult` asks a person about an error.
    """

    def __init__(
        self,
        store: RecordStore,
        cell: Cell,
        campaign: Campaign,
        consult: Callable[[AcquisitionError], Answer],
    ) -> None:
        self._store = store
        self._cell = cell
        self._campaign = campaign
        self._consult = consult
        self._again = 0
        self._looked: int | None = None  # the last of the readings that were there when it was looked at

    def cell(self) -> Cell:
        """Return the cell with its cups where they were touched.

        Before the poses are planned for them, it is the cell of the file.
        """
        taught = taught_of(self._store, self._cell)
        if taught is None or not self._planned_for(taught):
            return self._cell
        return with_nests(self._cell, taught.nests_mm)

    def look(self) -> bool:
        """Plan the poses again once all available touches and sides are measured.

        Returns whether the plan has changed. Errors of a question to a person are passed on.

        Raises
        ------
        CupsDisagree
            Touches and sides still disagree after several repetitions.
        """
        last = self._store.database.query(_MEASURED)[0][0]
        if last == self._looked:
            return False
        self._looked = last
        taught = taught_of(self._store, self._cell)
        if taught is None or self._planned_for(taught) or self._some_are_left():
            return False
        if self._doubted(taught):
            return True
        there = with_nests(self._cell, taught.nests_mm)
        frame = taught.frame
        with self._store.changing():
            moved, left_out = self._plan(there)
            self._store.add_event(
                "taught",
                readings=list(taught.readings),
                nests_mm=taught.nests_mm,
                touched_mm=dict(taught.touched_mm),
                sides_mm={f"{one} {other}": side for (one, other), side in taught.sides_mm.items()},
                off_mm=max(
                    float(np.linalg.norm(np.subtract(place, self._cell.nests[name])))
                    for name, place in taught.nests_mm.items()
                ),
                robot_in_cups=None if frame is None else frame.as_json(),
                poses=moved,
                refused=left_out,
            )
        return True

    def _planned_for(self, taught: Taught) -> bool:
        rows = self._store.database.query(_LAST)
        return bool(rows) and rows[0][0] == _as_json(taught.readings)

    def _some_are_left(self) -> bool:
        """Check whether touches, or sides in their block, are not measured yet."""
        return any(each.status == "planned" for each in block_of_touches(self._store, self._cell))

    def _doubted(self, taught: Taught) -> bool:
        """Check whether touches or sides must be measured again.

        Raises
        ------
        CupsDisagree
            They still disagree after several repetitions, or no pose can be planned from them.
        """
        impossible = False
        try:
            _ = taught.nests_mm
        except (DataError, ValueError) as error:
            wrong = CupsDisagree(f"the base triangle is impossible: {error}", device="instrument")
            again, impossible = list(taught.side_poses), True
        else:
            if not (accused := taught.accused):
                return False
            wrong = CupsDisagree(_in_words(taught), device="robot")
            again = [taught.poses[name] for name in accused]
        self._again += 1
        if self._again > self._campaign.retries + 1:
            raise wrong
        if self._consult(wrong) is not Answer.CONFIRM:
            if impossible:
                raise wrong  # no pose can be planned from it
            return False
        self._store.measure_again(again, wrong.message)
        return True

    def _plan(self, there: Cell) -> tuple[int, int]:
        """Plan the poses again for the cell `there`.

        Returns the numbers of poses that were planned and left out.
        """
        visits: dict[int, list[PlannedReading]] = {}
        for planned in self._store.plan():
            if planned.visit.kind == "pose":
                visits.setdefault(planned.visit.number, []).append(planned)
        moved = left_out = 0
        for number, block in enumerate(self._campaign.blocks):
            adaptive = isinstance(block, AdaptiveBlock)
            if not adaptive and (not isinstance(block, HexapodBlock | SphereBlock) or not block.lengths):
                continue
            untouched = [
                group
                for group in visits.values()
                if group[0].visit.block == number and all(each.status == "planned" for each in group)
            ]
            for group, elsewhere in zip(
                untouched, self._visits(there, number, block, untouched), strict=True
            ):
                if elsewhere is None:
                    left_out += 1
                    for each in group:
                        self._store.mark(each.id, "skipped", "not reached from where the cups are")
                else:
                    moved += 1
                    self._store.replan(group, _moved(group[0].visit, elsewhere))
        return moved, left_out

    def _visits(
        self,
        there: Cell,
        number: int,
        recipe: AdaptiveBlock | HexapodBlock | SphereBlock,
        groups: Sequence[Sequence[PlannedReading]],
    ) -> list[BlockVisit | None]:
        """Find for each pose the one with the same legs in the same branch in the moved cell.

        None replaces a pose that is not reached.
        """
        site = site_of(there, self._campaign, number)
        try:
            if isinstance(recipe, AdaptiveBlock):
                pool = pool_of(recipe, site)
                found = [pool.visit(site, i, 0) for i in range(len(pool.candidates))]
                return [_same_pose(group[0].visit, found) for group in groups]
            if isinstance(recipe, HexapodBlock):
                found = recipe.model_copy(update={"count": None, "configurations": "all"}).visits_at(site)
                return [_same_pose(group[0].visit, found) for group in groups]
            found = recipe.model_copy(update={"centre_deg": self._centre(there, recipe)}).visits_at(site)
        except ConfigError:
            return [None] * len(groups)
        by_name = {f"{elsewhere.what} of block {number + 1} ": elsewhere for elsewhere in found}
        return [
            next(
                (elsewhere for name, elsewhere in by_name.items() if group[0].visit.name.startswith(name)),
                None,
            )
            for group in groups
        ]

    def _centre(self, there: Cell, recipe: SphereBlock) -> Joints:
        """Return the centre of a sphere, moved with its cup.

        Raises
        ------
        ConfigError
            The arm does not reach it.
        """
        robot, base = self._cell.robot, recipe.base or ""
        taught = np.array([recipe.centre_deg])
        flange = forward(robot.model, robot.model_angles(taught))
        flange[:, :3, 3] += np.subtract(there.nests[base], self._cell.nests[base])
        found = configurations(there, flange, taught[0])
        branch = nearest_branch(found, taught)[0]
        if branch < 0:
            raise ConfigError(
                f"the arm does not reach {base} where it was touched",
                what_to_do="Move the cup, or touch it in another posture.",
            )
        return rounded(found[0, branch])


def _as_json(readings: Sequence[int]) -> str:
    return f"[{','.join(map(str, readings))}]"


def _same_pose(visit: Visit, found: Sequence[BlockVisit]) -> BlockVisit | None:
    """Return the pose with the same legs that is nearest in joint space, if it is near."""
    legs = set(visit.readings)
    alike = [elsewhere for elsewhere in found if set(elsewhere.distances) == legs]
    if not alike:
        return None
    apart = np.abs(np.array([elsewhere.joints_deg for elsewhere in alike]) - np.array(visit.joints_deg)).max(
        axis=1
    )
    nearest = int(np.argmin(apart))
    return alike[nearest] if apart[nearest] <= SAME_POSE_DEG else None


def _moved(visit: Visit, elsewhere: BlockVisit) -> Visit:
    return replace(
        visit,
        joints_deg=elsewhere.joints_deg,
        sides=elsewhere.sides,
        approach_deg=elsewhere.approach_deg,
    )


def _in_words(taught: Taught) -> str:
    said = [
        f"{one} to {other} is {taught.sides_mm[one, other] + off:.2f} mm by the touches and "
        f"{taught.sides_mm[one, other]:.3f} mm by the bar"
        for (one, other), off in taught.disagreements.items()
    ]
    names = taught.accused
    who = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
    return f"{'; '.join(said)}: {who} was not touched where it is, or has moved since"
