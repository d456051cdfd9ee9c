"""One history: a cell, its service, the people and programs that use it, and all faults.

All of it comes from the seed. The devices are the simulators of `mocks`, behind their own wires. A history is a list
of steps, each at its time: an order of a person, or a fault. It ends in peace: nothing breaks any more, a person
resumes resting runs and answers open prompts, and every campaign must come to its end.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sqlite3
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from acquisition import read_cell
from acquisition.record import FILE
from mocks.cell import CellThread
from mocks.cell_file import read_cell as read_simulated_cell
from tests.simulation import modules
from tests.simulation.cells import CELLS, REST
from tests.simulation.programs import HttpAnswer, Program, SimulatedDisk
from tests.simulation.scheduler import Process, Scheduler
from tests.simulation.wires import Network

FOLDER = Path("/dev/shm" if os.path.isdir("/dev/shm") else "/tmp") / "truepose-simulation"
OFFSET_DEG = -5.0
# Where the target is at each planned reading of a cell, from a calm campaign.
REFERENCE: dict[str, dict[str, tuple[float, float, float]]] = {}

SECONDS = 45.0  # in which things happen; a campaign takes 20 s
PEACE_S = 600.0  # within which everything must have ended then
BURSTS = 0.4  # share of the steps that come close to another
PEOPLE = ("anna", "bert")
AT_REST_S, OVER_S = (
    0.5,
    30.0,
)  # from the acknowledgement of a stop: until the robot rests, until its run has ended
GRACE_S = 0.5  # from the end of a lease to the last motion that may begin
ORDERS = {
    "start": 10,
    "take": 10,
    "beat": 6,
    "resume": 12,
    "pause": 5,
    "stop": 6,
    "answer": 10,
    "take over": 2,
    "give back": 1,
    "finish": 1,
    "restation": 1,
    "delete": 1,
    "export": 2,
    "look": 4,
    "dry run": 1,
}
FAULTS = {
    "cut": 6,
    "silence": 3,
    "slow": 3,
    "twice": 3,
    "refuse": 2,
    "emergency stop": 2,
    "reboot": 2,
    "clock": 2,
    "full disk": 2,
    "slow disk": 4,
    "kill": 4,
    "end": 2,
}


@dataclass(frozen=True)
class Step:
    """One order of a person, or one fault of a part; `draw` seeds its further choices."""

    at_s: float
    what: str
    who: str = ""
    draw: int = 0

    def __str__(self) -> str:
        return f"{self.at_s:8.3f} s  {self.who or '-'}: {self.what}"


def steps_of(seed: int) -> list[Step]:
    """Draw the steps of a seed."""
    draw = Random(f"steps {seed}")
    steps = [
        Step(0.0, "take", "anna", draw.randrange(2**30)),
        Step(0.5, "start", "anna", draw.randrange(2**30)),
    ]
    for names, most, people in ((ORDERS, 30, PEOPLE), (FAULTS, draw.choice([0, 1, 3, 8]), ("",))):
        some = draw.sample(
            list(names), draw.randint(1, len(names))
        )  # many of a few kinds find more than few of all
        for _ in range(draw.randint(0, most)):
            (what,) = draw.choices(some, [names[each] for each in some])
            at_s = draw.uniform(0.0, SECONDS)
            if draw.random() < BURSTS:  # close to another
                at_s = draw.choice(steps).at_s + draw.choice([0.0, 0.001, 0.05, 0.5]) * draw.random()
            steps.append(Step(round(at_s, 4), what, draw.choice(people), draw.randrange(2**30)))
    return sorted(steps, key=lambda step: step.at_s)


@dataclass
class Participant:
    """Someone at the page of a service, who holds its lease or not."""

    name: str
    program: Program
    lease_id: str = ""
    seconds: float = 300.0


@dataclass
class Order:
    """A stop or pause that the service has acknowledged, and that no one has lifted since."""

    verb: str
    at_s: float
    motions: int = 0  # since then


@dataclass
class History:
    """One seed from an empty record to the end of the last campaign.

    Attributes
    ----------
    found
        What must never happen, and did.
    """

    seed: int
    steps: Sequence[Step]
    found: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        draw = Random(f"world {self.seed}")
        self.scheduler = Scheduler(self.seed, draw.choice([0.0, 0.02, 0.1, 0.3]))
        self.network = Network(self.scheduler)
        self.disk = SimulatedDisk()
        self._robot, self._tracker, self._arm_text, self._poses = draw.choice(CELLS)
        self._attended = draw.random() < 0.8
        self._one_smr, self._two = draw.random() < 0.5, draw.random() < 0.3
        self._cell: CellThread
        self._people: dict[str, Participant] = {}
        self._programs: list[Program] = []
        self._orders: dict[str, Order] = {}  # the stop or pause of a run that holds
        self._resumed: dict[str, float] = {}  # when an order to resume a run was sent last
        self._readings: dict[str, dict[int, tuple[Any, ...]]] = {}
        # To prompts, by run and prompt: what was acknowledged first, and the key of that request.
        self._answers: dict[tuple[str, str], tuple[str, str]] = {}
        self._starts: set[str] = set()  # keys of the orders to start a run
        self._gone: set[str] = set()  # runs that somebody has deleted
        self._peaceful = False
        self._full = any(
            step.what == "full disk" for step in self.steps
        )  # then a run may rest before its stop
        self._doing = 0
        self.campaigns = 0  # that have ended

    @property
    def _campaign(self) -> dict[str, Any]:
        return {
            "format": "truepose-campaign/1",
            "seed": 1,
            "settle_s": 0.5,
            "samples": 10,
            "approach": {"offset_deg": OFFSET_DEG, "sides": "one"},
            "block": [{"kind": "poses", "set": "calibration", "select": "list", "joints_deg": self._poses}],
        }

    @property
    def _allowed(self) -> list[Sequence[float]]:
        return [*self._poses, *([q + OFFSET_DEG for q in pose] for pose in self._poses)]

    @property
    def log(self) -> list[str]:
        """Events of the history, the same on every machine."""
        return [line.replace(str(self._folder), "FOLDER") for line in self.scheduler.log]

    def find(self, text: str) -> None:
        """Note what must never happen."""
        self.scheduler.note(f"WRONG: {text}")
        self.found.append(f"{self.scheduler.now:.3f} s: {text}")

    def run(self) -> History:
        modules.WORLD.scheduler, modules.WORLD.network, modules.WORLD.disk = (
            self.scheduler,
            self.network,
            self.disk,
        )
        self._folder = FOLDER / str(os.getpid())
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)
        files = len(os.listdir("/proc/self/fd"))
        try:
            self.scheduler.run(self._main)
            left = [f"{each.process.name}/{each.name}" for each in self.scheduler.tasks.values()]
            if left:
                self.found.append(f"threads are left: {', '.join(left)}")
            killed = any(step.what == "kill" for step in self.steps)  # whose files no one closes
            if (more := len(os.listdir("/proc/self/fd")) - files) > 0 and not killed:
                self.found.append(f"{more} files are left open")
        except Exception as error:  # noqa: BLE001 - a deadlock, or a fault of the harness: both are findings
            self.found.append("".join(traceback.format_exception(error)))
        self.found += self.network.died
        shutil.rmtree(self._folder, ignore_errors=True)
        return self

    # -- the cell ------------------------------------------------------------------------------------------

    def _main(self) -> None:
        file = self._folder / "cell.toml"
        head = 'format = "truepose-cell/1"\nname = "simulated"\n'
        text = head + self._arm_text + REST
        for name, value in (
            ("ONE_SMR", str(self._one_smr).lower()),
            ("ROBOT_PORT", "5000"),
            ("TRACKER_PORT", "5701"),
            ("ROBOT", self._robot),
            ("TRACKER", self._tracker),
        ):
            text = text.replace(name, value)
        file.write_text(text, "utf-8")
        up, over, ended = modules.SimulatedEvent(), modules.SimulatedEvent(), modules.SimulatedEvent()

        def devices() -> None:
            with CellThread(read_simulated_cell(file), devices=(self._robot, self._tracker)) as cell:
                self._cell = cell
                up.set()
                over.wait()
            ended.set()

        self.scheduler.spawn("devices", devices, Process("devices"))
        up.wait()
        ports = {end.device: end.port for end in self._cell.endpoints}
        text = text.replace(":5000", f":{ports[self._robot]}").replace(":5701", f":{ports[self._tracker]}")
        file.write_text(text, "utf-8")
        assert self._cell.cell is not None
        arm = self._cell.cell.arm
        begin = arm.start

        def started(target: Sequence[float], **rates: float) -> None:
            self._moves(target)
            begin(target, **rates)

        arm.start = started  # type: ignore[method-assign]
        self._robot_port = ports[self._robot]
        for name in ("service", "other")[: 2 if self._two else 1]:
            self._programs.append(Program(self, name, self._folder / name, read_cell(file)))
            self._programs[-1].start()
        self._people = {
            name: Participant(name, each) for name, each in zip(PEOPLE, 2 * self._programs, strict=False)
        }
        if self._attended and self._one_smr:
            for program in self._programs:
                self.scheduler.spawn("attendant", lambda program=program: self._attend(program))
        for number, step in enumerate(self.steps):
            self.scheduler.at(step.at_s, lambda step=step, number=number: self._begin(step, number))
        self.scheduler.sleep(SECONDS)
        self._peace()
        for each in self._programs:
            each.end()
        over.set()
        ended.wait()
        self.scheduler.sleep(10.0)  # for the last lines of every thread

    def _moves(self, target: Sequence[float]) -> None:
        """Judge a motion that begins."""
        now = self.scheduler.now
        self.scheduler.note(f"moves to {[round(q, 3) for q in target]}")
        if not any(
            all(abs(a - b) < 1e-3 for a, b in zip(target, each, strict=True)) for each in self._allowed
        ):
            self.find(f"the robot moves to {list(target)}, which no plan has")
        at_it = {
            client.process.name
            for wire, client, _ in self.network.wires
            if client.open and wire.port == self._robot_port and client.process.alive
        }
        if len(at_it) != 1:
            self.find(f"the robot moves, and connected to it are: {', '.join(sorted(at_it)) or 'none'}")
            return
        program = next(each for each in self._programs if each.name in at_it)
        order = self._orders.get(program.service.book.busy_with)
        if order is not None and now > order.at_s:
            order.motions += 1
            if order.motions > (0 if order.verb == "stop" else 2):  # of the current reading
                self.find(f"the robot moves, {now - order.at_s:.3f} s after the {order.verb} of its run")
            return
        held = program.service.lease._held
        left = -math.inf if held is None else held.beats.left_s
        if left < -GRACE_S:
            self.find(f"the robot moves, {-left:.3f} s after the end of the lease")

    # -- steps ---------------------------------------------------------------------------------------------

    def _begin(self, step: Step, number: int) -> None:
        if self._peaceful:
            return
        self._doing += 1

        def work() -> None:
            try:
                self.scheduler.note(f"{step.what} begins")
                draw = Random(step.draw)
                if step.who:
                    self._order(self._people[step.who], step.what, draw, f"{number}")
                else:
                    self._break(step.what, draw)
            finally:
                self._doing -= 1

        self.scheduler.spawn(f"{step.who or 'fault'} {number}", work, self.scheduler.harness)

    def _ask(
        self, person: Participant, draw: Random, key: str, method: str, path: str, body: Any = None
    ) -> HttpAnswer:
        """Send a request on a bad network, and again if the request or its answer is lost."""
        headers, program = {"Lease_Id": person.lease_id, "Idempotency_Key": key}, person.program
        for _ in range(3):
            if draw.random() < 0.05:  # lost on the way
                self.scheduler.sleep(draw.uniform(0.1, 3.0))
                continue
            if draw.random() < 0.05:  # sent twice at once
                self.scheduler.spawn(
                    "twin", lambda: self._noted(program, method, path, body, headers), self.scheduler.harness
                )
            answer = self._noted(program, method, path, body, headers)
            if draw.random() >= 0.05:
                return answer
            self.scheduler.sleep(draw.uniform(0.1, 3.0))  # the answer is lost
        return HttpAnswer()

    def _noted(
        self, program: Program, method: str, path: str, body: Any, headers: dict[str, str]
    ) -> HttpAnswer:
        """Send a request, and note what it allows or forbids the robot."""
        run, _, order = path.removeprefix("/runs/").partition("/")
        sent_s, resumed, lifted = self.scheduler.now, -1.0, None
        if order in ("resume", "restation"):
            resumed, lifted = self._resumed.get(run, -1.0), self._orders.pop(run, None)
            self._resumed[run] = sent_s
        elif path == "/runs" and method == "POST" and not body["dry_run"]:
            self._starts.add(headers["Idempotency_Key"])
        answer = program.ask(method, path, body, **headers)
        self.scheduler.note(f"{method} {path}: {answer.status} {_short(answer)}")
        if order in ("resume", "restation") and answer.status >= 400 and self._resumed[run] == sent_s:
            self._resumed[run] = resumed  # it was refused: what it would have lifted holds
            if lifted is not None:
                self._orders.setdefault(run, lifted)
        elif answer.status == 202 and order in ("stop", "pause") and not answer.body.get("problems"):
            self._ordered(program, run, order, sent_s)
        elif (path == "/cell/lease/takeover" and answer.status == 200) or (method, answer.status) == (
            "DELETE",
            204,
        ):
            busy = program.service.book.busy_with if program.alive else None
            if busy is not None:
                self._ordered(program, busy, "end of the lease", self.scheduler.now)
        elif answer.status == 200 and order.startswith("prompts/"):
            _, prompt, verb = order.split("/")
            key = headers.get("Idempotency_Key", f"{sent_s}")
            first, by = self._answers.setdefault((run, prompt), (verb, key))
            if by != key:
                self.find(f"run {run}: prompt {prompt} was answered {first}, and then {verb}")
        return answer

    def _ordered(self, program: Program, run: str, verb: str, sent_s: float) -> None:
        """Note an order that must bring a run to rest, unless the run was resumed after it was sent."""
        if self._resumed.get(run, -1.0) >= sent_s or (run in self._orders and verb != "stop"):
            return
        order = self._orders[run] = Order(verb, self.scheduler.now)
        if verb != "stop" or not program.alive or program.service.book.busy_with != run:
            return
        assert self._cell.cell is not None
        arm, moves = self._cell.cell.arm, len(self._cell.cell.arm.sent_to)

        def at_rest() -> None:
            if arm.moving and len(arm.sent_to) == moves:
                self.find(f"the robot moves on, {AT_REST_S:g} s after a stop was acknowledged")

        def over() -> None:
            if self._orders.get(run) is not order or not program.alive or self._full:
                return
            if program.service.book.busy_with == run:
                self.find(f"run {run} goes on, {OVER_S:g} s after a stop was acknowledged")
            elif (state := program.service.book._runs[run]._store.state.value) != "stopped":
                self.find(f"run {run} is {state} after a stop")

        self.scheduler.at(self.scheduler.now + AT_REST_S, at_rest)
        self.scheduler.at(self.scheduler.now + OVER_S, lambda: self.scheduler.spawn("look", over))

    def _run_in_view(self, program: Program, draw: Random) -> dict[str, Any] | None:
        real = self._runs_of(program)
        return draw.choice(real[:2]) if real else None

    def _runs_of(self, program: Program) -> list[dict[str, Any]]:
        runs = (program.ask("GET", "/runs").body or {}).get("runs") or []
        return [run for run in runs if not run["dry_run"]]

    def _order(self, person: Participant, what: str, draw: Random, number: str) -> None:
        key = f"{person.name}-{number}"

        def ask(method: str, path: str, body: Any = None) -> HttpAnswer:
            return self._ask(person, draw, key, method, path, body)

        if what in ("take", "take over", "beat"):
            if what == "take":
                person.seconds = draw.choice([3.0, 3.0, 10.0, 300.0])
            path = "/cell/lease/takeover" if what == "take over" else "/cell/lease"
            body = {"holder": person.name, "seconds": person.seconds}
            answer = ask("POST", path, body | ({"reason": "mine"} if what == "take over" else {}))
            if answer.status == 409:  # that of an earlier lease
                person.lease_id = ""
            if answer.status == 200 and answer.body["lease_id"]:
                person.lease_id = answer.body["lease_id"]
        elif what == "give back":
            ask("DELETE", "/cell/lease")
        elif what in ("start", "dry run"):
            ask("POST", "/runs", {"campaign": self._campaign, "dry_run": what == "dry run"})
        elif (run := self._run_in_view(person.program, draw)) is not None:
            where = f"/runs/{run['id']}"
            if what == "resume":
                ask("POST", f"{where}/resume", {})
            elif what in ("pause", "stop"):
                ask("POST", f"{where}/{what}")
            elif what in ("finish", "restation"):
                ask("POST", f"{where}/{what}", {"reason": "enough"})
            elif what == "delete":
                if ask("DELETE", where, {"reason": "not needed"}).status == 200:
                    self._gone.add(run["id"])
            elif what == "export":
                ask("POST", f"{where}/dataset", {"name": "all"})
            elif what == "look":
                ask("GET", where)
            elif what == "answer":
                self._answer(person.program, run, ask, draw)

    def _attend(self, program: Program) -> None:
        """Confirm what a service asks, until there is peace."""
        draw, count = Random(f"attendant {self.seed}"), 0
        while not self._peaceful:
            self.scheduler.sleep(draw.choice([0.2, 1.0, 3.0]))
            for run in self._runs_of(program):
                if prompt := run["prompt"]:
                    count += 1
                    key = {"Idempotency_Key": f"attendant-{program.name}-{count}"}
                    self._noted(program, "POST", f"/runs/{run['id']}/prompts/{prompt['id']}/confirm", {}, key)

    def _answer(
        self, program: Program, run: dict[str, Any], ask: Callable[..., HttpAnswer], draw: Random
    ) -> None:
        for _ in range(50):
            document = program.ask("GET", f"/runs/{run['id']}").body or {}
            if prompt := document.get("prompt"):
                break
            self.scheduler.sleep(0.1)
        else:
            return
        self.scheduler.sleep(draw.choice([0.0, 0.5, 5.0]))
        where = f"/runs/{run['id']}/prompts/{prompt['id']}"
        if draw.random() < 0.5:  # somebody else answers at the same time
            other, key = draw.choice(prompt["expects"]), {"Idempotency_Key": f"other {draw.random()}"}
            self.scheduler.spawn(
                "other",
                lambda: self._noted(program, "POST", f"{where}/{other}", {}, key),
                self.scheduler.harness,
            )
        ask("POST", f"{where}/{draw.choice(['confirm', *prompt['expects']])}", {})

    def _break(self, what: str, draw: Random) -> None:
        scheduler, network = self.scheduler, self.network
        seconds = draw.choice([0.3, 2.0, 8.0])
        lines = [line for line in network.wires if line[1].open]
        if what in ("cut", "silence", "slow", "twice") and lines:
            wire, client, transport = draw.choice(lines)
            if what == "cut":
                network.cut(client, transport)
            elif what == "silence":
                wire.silent = True
                scheduler.sleep(draw.choice([0.5, 5.0, 60.0]))
                wire.mend()
            elif what == "twice":
                wire.doubles = draw.randint(1, 3)
            else:
                wire.delay_s = seconds / 4
        elif what == "refuse":
            network.refuses = True
            scheduler.sleep(seconds)
            network.refuses = False
        elif what == "emergency stop":
            assert self._cell.cell is not None
            self._cell.cell.arm.press_emergency_stop()
            scheduler.sleep(seconds)
            self._device("restart")
        elif what == "reboot":
            self._device("reboot")
        elif what == "clock":
            scheduler.utc_offset += draw.choice([-3600.0, -1.0, 1.0, 3600.0])
        elif what == "full disk":
            self.disk.full = True
            scheduler.sleep(seconds)
            self.disk.full = False
        elif what == "slow disk":
            self.disk.slow_s = draw.choice([0.02, 0.1, 0.5])
            scheduler.sleep(seconds)
            self.disk.slow_s = 0.0
        elif what in ("kill", "end"):
            program = draw.choice(self._programs)
            self._look_at_readings()
            program.kill() if what == "kill" else program.end()
            scheduler.sleep(seconds)
            if not program.alive:
                program.start()

    def _device(self, order: str) -> None:
        """Have the simulated devices carry out an order of their back door."""
        cell, done = self._cell, modules.SimulatedEvent()

        async def do() -> None:
            try:
                assert cell.cell is not None
                await cell.cell.backdoor.do({"do": order})
            finally:
                done.set()

        assert cell._loop is not None
        tasks: list[Any] = []
        loop = cell._loop
        loop.call_soon_threadsafe(lambda: tasks.append(loop.create_task(do())))
        done.wait()

    # -- peace ---------------------------------------------------------------------------------------------

    def _peace(self) -> None:
        """Let every campaign come to its end, and check its readings and prompts."""
        self._peaceful = True
        self.scheduler.note("peace")
        while self._doing:
            self.scheduler.sleep(0.5)
        self.disk.full, self.disk.slow_s, self.network.refuses = False, 0.0, False
        for wire, _, _ in self.network.wires:
            wire.mend()
        self._device("restart")
        for program in self._programs:
            if not program.alive:
                program.start()
        self._look_at_readings()
        end = self.scheduler.now + PEACE_S
        for program in self._programs:
            while (left := self._left(program)) and self.scheduler.now < end:
                self._let_go_on(program, left[0]["id"])
            for run in left:
                self.find(f"run {run['id']} does not come to its end: {run['state']}, {run['reason']}")
            self.campaigns += len(self._runs_of(program)) - len(left)
        if (more := self.campaigns + len(self._gone) - len(self._starts)) > 0:
            self.find(f"{more} more runs than were ordered")
        self._look_at_readings()
        self._look_at_prompts()

    def _left(self, program: Program) -> list[dict[str, Any]]:
        return [run for run in self._runs_of(program) if run["state"] != "succeeded"]

    def _let_go_on(self, program: Program, name: str) -> None:
        """Resume a run, and stay with it until it rests or has ended."""
        body = {"holder": "anna", "seconds": 300, "reason": "peace"}
        held = self._noted(program, "POST", "/cell/lease/takeover", body, {})
        lease = {"Lease_Id": held.body["lease_id"]} if held.status == 200 else {}
        self._noted(program, "POST", f"/runs/{name}/resume", {}, lease)
        for _ in range(100):
            self.scheduler.sleep(2.0)
            run = program.ask("GET", f"/runs/{name}").body
            if run is None or run["state"] not in ("running", "waiting_for_operator"):
                return
            if prompt := run["prompt"]:
                path = f"/runs/{name}/prompts/{prompt['id']}/confirm"
                self._noted(program, "POST", path, {}, lease)

    def _records(self) -> dict[str, Path]:
        folders = [each.record / "runs" for each in self._programs]
        found = [each for folder in folders for each in sorted(folder.glob("*"))]
        return {each.name: each / FILE for each in found if (each / FILE).is_file()}

    def _look_at_readings(self) -> None:
        """Compare the good readings of every record with those that it had before."""
        records = self._records()
        for name in self._readings.keys() - records.keys() - self._gone:
            self.find(f"run {name} has gone with {len(self._readings[name])} readings")
        for name, file in records.items():
            connection = sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)
            try:
                rows = connection.execute(
                    "SELECT a.id, a.pose, p.kind || ' ' || p.name || ' ' || p.target, a.raw, a.checksum, "
                    "a.tracker_x_mm, a.tracker_y_mm, a.tracker_z_mm FROM attempt AS a JOIN pose AS p ON p.id = a.pose "
                    "WHERE a.kind = 'measure' AND a.status = 'good'"
                ).fetchall()
            except sqlite3.OperationalError:
                rows = []  # it was not made to its end
            finally:
                connection.close()
            now = {row[0]: row for row in rows}
            for number, row in self._readings.get(name, {}).items():
                if now.get(number) != row:
                    self.find(f"run {name}: reading {number} was {row} and is {now.get(number)}")
            poses = [row[1] for row in rows]
            if len(poses) > len(set(poses)):
                self.find(f"run {name}: a pose was measured twice")
            self._readings[name] = now
            for number, _, pose, *_, x, y, z in rows:
                if (where := REFERENCE.get(self._robot, {}).get(pose)) and math.dist(where, (x, y, z)) > 1.0:
                    self.find(
                        f"run {name}: reading {number} of pose {pose} is at {x}, {y}, {z} and not at {where}"
                    )

    def _look_at_prompts(self) -> None:
        for name, file in self._records().items():
            connection = sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)
            given = dict(connection.execute("SELECT id, answer FROM prompt").fetchall())
            (left,) = connection.execute("SELECT count(*) FROM attempt WHERE status = 'open'").fetchone()
            if left:
                self.find(f"run {name}: {left} attempts are open")
            connection.close()
            if open_now := [number for number, answer in given.items() if answer is None]:
                self.find(f"run {name}: prompts were neither answered nor withdrawn: {open_now}")
            for (run, prompt), (verb, _) in self._answers.items():
                if run == name and given.get(prompt) != verb:
                    self.find(
                        f"run {name}: {prompt} was answered {verb}, and the record has {given.get(prompt)}"
                    )


def _short(answer: HttpAnswer) -> str:
    body = answer.body
    if not isinstance(body, dict):
        return ""
    kept = {key: body[key] for key in ("id", "state", "reason", "detail", "done", "problems") if key in body}
    return json.dumps(kept)


def learn() -> list[History]:
    """Fill `REFERENCE` from campaigns in which nothing happens, and return their histories."""
    calm = []
    for cell in dict.fromkeys(CELLS):
        history = History(0, [step for step in steps_of(0) if step.at_s <= 0.5 and step.who])
        history._robot, history._tracker, history._arm_text, history._poses = cell
        history._one_smr = history._two = False
        calm.append(history.run())
        for rows in history._readings.values():
            REFERENCE[cell[0]] = {pose: (x, y, z) for _, _, pose, *_, x, y, z in rows.values()}
    return calm
