"""Changes to acquisition."""

from __future__ import annotations

from tests.sabotage.change import Change

_SEQUENCER = ("tests/acquisition/test_sequencer.py", "tests/acquisition/test_machine.py")
_STORE = ("tests/acquisition/test_store.py", "tests/acquisition/test_power_cut.py")
_PLAN = (
    "tests/acquisition/test_plan.py",
    "tests/acquisition/test_transit.py",
    "tests/acquisition/test_blocks.py",
)

CHANGES = (
    Change(
        "acquisition/database.py",
        'self.query("PRAGMA synchronous = FULL")',
        'self.query("PRAGMA synchronous = NORMAL")',
        "a power cut loses readings that were acknowledged",
        _STORE,
    ),
    Change(
        "acquisition/database.py",
        '                    self._connection.execute("ROLLBACK")\n',
        '                    self._connection.execute("COMMIT")\n',
        "half a change stays in the record",
        (*_STORE, "tests/acquisition/test_storage_faults.py"),
    ),
    Change(
        "acquisition/sequencer.py",
        "        arrival = self._attempts.begin_arrival(visit)\n        try:\n            for stand in way:\n"
        "                self._rig.move(stand)\n",
        "        for stand in way:\n            self._rig.move(stand)\n"
        "        arrival = self._attempts.begin_arrival(visit)\n        try:\n",
        "the robot moves before the record says so",
        _SEQUENCER,
    ),
    Change(
        "acquisition/sequencer.py",
        "        way = self._transit.way(self._rig.stands_deg(), visit.approach_deg)",
        "        way = self._transit.way(self._rig.stands_deg(), visit.joints_deg)",
        "no pose is approached from its side",
        _SEQUENCER,
    ),
    Change(
        "acquisition/sequencer.py",
        "        arrival, self._arrival = self._arrival, None  #",
        "        arrival = self._arrival  #",
        "an approach counts although something happened since",
        _SEQUENCER,
    ),
    Change(
        "acquisition/sequencer.py",
        "        if off > DISPLACED_DEG:\n            raise Displaced",
        "        if off > 100 * DISPLACED_DEG:\n            raise Displaced",
        "a joint turned by hand is not noticed",
        ("tests/acquisition/test_ballbar.py",),
    ),
    Change(
        "acquisition/rig.py",
        "                self.lost_in_move = not self._can_stop",
        "                self.lost_in_move = False",
        "a retry moves a robot that may still be moving",
        _SEQUENCER,
    ),
    Change(
        "acquisition/rig.py",
        "            # A stop between the look before and the arming must not be undone by it.\n"
        "            self._control.check_stop()\n",
        "",
        "a stop during the arming is undone by it",
        ("tests/acquisition/test_interrupt.py",),
    ),
    Change(
        "acquisition/rig.py",
        '        beside.start()\n        stop("robot", self._devices.robot)\n        beside.join()\n',
        '        stop("robot", self._devices.robot)\n        if not problems:\n            beside.start()\n'
        "            beside.join()\n",
        "an instrument goes on measuring when the robot could not be stopped",
        ("tests/acquisition/test_stop.py", "tests/acquisition/test_interrupt.py", *_SEQUENCER),
    ),
    Change(
        "acquisition/control.py",
        "        self._clock.wait(seconds, self._now)",
        "        self._clock.wait(seconds, self._any)",
        "a pause cuts the settling short, and the reading is taken all the same",
        ("tests/acquisition/test_interrupt.py", *_SEQUENCER),
    ),
    Change(
        "acquisition/control.py",
        "            self._reason = reason\n        self._now.set()\n",
        "            self._reason = reason\n",
        "a robot for which nobody answers any more begins another motion",
        ("tests/acquisition/test_interrupt.py", "tests/acquisition/test_lease.py", *_SEQUENCER),
    ),
    Change(
        "acquisition/store.py",
        "            db.execute(\"UPDATE prompt SET answer = 'void' WHERE answer IS NULL\")\n",
        "",
        "a prompt of a program that died is still open",
        _STORE + _SEQUENCER,
    ),
    Change(
        "acquisition/store.py",
        'self.seals.close(db, row["id"], status="died")',
        'self.seals.close(db, row["id"], status="good")',
        "an act that a crash cut off counts as done",
        ("tests/acquisition/test_store.py", *_SEQUENCER),
    ),
    Change(
        "acquisition/seal.py",
        '        return row["checksum"] == checksum(campaign["id"], table, row)\n',
        "        return True\n",
        "a reading that was damaged on the disk is exported",
        ("tests/acquisition/test_seal.py",),
    ),
    Change(
        "acquisition/seal.py",
        "            parts += (name, repr(float(value) + 0.0))",
        "            parts += (name, f'{value:g}')",
        "the checksum of a row does not see damage in the last digits",
        ("tests/acquisition/test_seal.py",),
    ),
    Change(
        "acquisition/mover.py",
        "            lock.acquire(timeout=0)\n",
        "            pass\n",
        "two campaigns move one robot",
        ("tests/acquisition/test_mover.py",),
    ),
    Change(
        "acquisition/mover.py",
        '            self._hold(self._stack, f"{maker} {serial}"',
        '            self._hold(self._stack, f"{maker} {serial} {self._url}"',
        "a robot that is reached by two addresses is moved twice",
        ("tests/acquisition/test_mover.py",),
    ),
    Change(
        "acquisition/store.py",
        "            \"AND pose.replaced_by IS NULL AND attempt.status = 'good'\"",
        "            \"AND attempt.status = 'good'\"",
        "nests that are not trusted any more make the world frame",
        ("tests/acquisition/test_nests.py", *_STORE, *_SEQUENCER),
    ),
    Change(
        "acquisition/check.py",
        '("the approach point of ", np.array([visit.approach_deg for visit in standing])),',
        '("the approach point of ", np.array([visit.joints_deg for visit in standing])),',
        "approach points are not held against limits and table",
        _PLAN,
    ),
    Change(
        "acquisition/check.py",
        "cell.clearance.contacts(approaches, poses)",
        "cell.clearance.contacts(poses, poses)",
        "the last part of the way to a pose may pass through a box",
        _PLAN,
    ),
    Change(
        "acquisition/clearance.py",
        "int(which.sum())) - self.arm.radii[which]",
        "int(which.sum()))",
        "the arm is a line without thickness",
        ("tests/acquisition/test_clearance.py", "tests/acquisition/test_transit.py"),
    ),
    Change(
        "acquisition/clearance.py",
        "        slack = bends[pieces.move] * 0.25 ** (halving + 1) / 8.0",
        "        slack = 0.0 * bends[pieces.move]",
        "a move may graze a post between two looks",
        ("tests/acquisition/test_clearance.py", "tests/acquisition/test_transit.py"),
    ),
    Change(
        "acquisition/station.py",
        "np.linalg.inv(2.0 * each)",
        "np.linalg.inv(0.1 * each)",
        "noise is taken for a new station of the instrument",
        ("tests/acquisition/test_station.py", "tests/acquisition/test_nests.py"),
    ),
    Change(
        "acquisition/world_frame.py",
        "        if abs(found - expected) > tolerance_mm:",
        "        if found - expected > tolerance_mm:",
        "nests that lie too near to each other make a world frame",
        ("tests/acquisition/test_world_frame.py",),
    ),
    Change(
        "acquisition/gates.py",
        "between and self._since_nests >= check.every:",
        "between and self._since_nests > check.every:",
        "nests are checked one reading too late",
        ("tests/acquisition/test_gates.py",),
    ),
    Change(
        "acquisition/gates.py",
        "            if len(last) < gate.over or spread is None",
        "            if spread is None",
        "an arm counts as warm after its first reading",
        ("tests/acquisition/test_gates.py",),
    ),
    Change(
        "acquisition/plan.py",
        "since >= campaign.reference_every:",
        "since > campaign.reference_every:",
        "the reference pose comes one reading too late",
        _PLAN,
    ),
    Change(
        "acquisition/expected.py",
        "        if from_target <= limit:",
        "        if from_target <= 100.0 * limit:",
        "a reading of the neighbouring target is believed",
        ("tests/acquisition/test_expected.py",),
    ),
    Change(
        "acquisition/export.py",
        '("prev{}_deg", "approach_deg", 6),',
        '("prev{}_deg", "joints_deg", 6),',
        "the data set says that no joint moved on its way to a pose",
        ("tests/acquisition/test_export.py", "tests/acquisition/test_blocks.py"),
    ),
    Change(
        "acquisition/settling.py",
        "        if apart <= max(now.resolution_deg, before.resolution_deg):",
        "        if apart <= 1.0:",
        "an arm that still swings is read",
        (*_SEQUENCER, "tests/acquisition/test_gates.py"),
    ),
)
