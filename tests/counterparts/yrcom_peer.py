"""Run by the Python of yrcom's environment: `client PORT` or `replay CAPTURE.json`.

As a client it reads a controller, writes variables, selects and starts a job, holds and releases, and prints what it
read as one JSON line. As a server it prints its port, and answers as recorded until its input ends.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from yrcom import (  # pyright: ignore[reportMissingImports]
    HsesClient,
    HsesError,
    HsesReplayServer,
    PositionVar,
)


def refused(verb: Any, *arguments: Any) -> bool:
    try:
        verb(*arguments)
    except HsesError:
        return True
    return False


def client(port: int) -> None:
    with HsesClient("127.0.0.1", port, 5.0) as robot:
        said: dict[str, Any] = {"status": robot.read_status(), "info": robot.read_system_info(11)}
        said["axes"] = robot.read_axis_config(1)["axes"]
        pulses = [14353, -26006, 4266, 9699, -4901, 45475, 0, 0]
        robot.write_position_var(90, PositionVar(0, axes=tuple(pulses)))
        said["target"] = list(robot.read_position_var(90).axes)
        weights = (5, 7, 11, 13, 17, 19)
        total = 4711 + 3 * 5000 + sum(w * p for w, p in zip(weights, pulses, strict=False))
        for variable, value in ((96, 5000), (91, total), (90, 4711)):
            robot.write_d_var(variable, value)
        robot.set_cycle(2)
        robot.select_job("TRUEPOSE1")
        said["job"] = robot.read_job()["job_name"]
        robot.hold(True)
        said["held"] = robot.read_status()["hold_cmd"]
        said["start while held"] = refused(robot.start_job)
        robot.hold(False)
        robot.start_job()
        while robot.read_d_var(92) != 47112 or robot.read_status()["running"]:
            pass
        said["position"] = robot.read_position(1)
        said["following error"] = robot.read_position_error(1)
        said["alarm"] = robot.read_alarm(1)["alarm_code"]
        said["no such job"] = refused(robot.select_job, "NOWHERE")
        said["undefined position"] = refused(robot.read_position_var, 7)
    sys.stdout.write(json.dumps(said) + "\n")


def replay(capture: str) -> None:
    with HsesReplayServer.from_capture(capture) as server:
        sys.stdout.write(f"{server.port}\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    {"client": lambda: client(int(sys.argv[2])), "replay": lambda: replay(sys.argv[2])}[sys.argv[1]]()
