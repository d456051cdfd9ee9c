"""Two clients of Robot Web Services against a server, in a separate environment.

Called as `.counterparts/rws/bin/python rws_peer.py PORT rws1|rws2`: abb-robot-client speaks RWS 1 and reads states and
joints, rwswrap speaks RWS 2 and stops the RAPID program. Prints one JSON object.
"""

from __future__ import annotations

import json
import sys
import warnings


def rws1(port: int) -> dict[str, object]:
    from abb_robot_client.rws import RWS  # pyright: ignore[reportMissingImports]

    robot = RWS(f"http://127.0.0.1:{port}")
    return {
        "controller": robot.get_controller_state(),
        "mode": robot.get_operation_mode(),
        "execution": robot.get_execution_state().ctrlexecstate,
        "joints": robot.get_jointtarget().robax.tolist(),
    }


def rws2(port: int) -> dict[str, object]:
    from rwswrap.RWS import RWS  # pyright: ignore[reportMissingImports]

    warnings.simplefilter("ignore")  # it believes every certificate
    robot = RWS(f"https://127.0.0.1:{port}", username="Default User")
    before = robot.get_exec_state()
    stopped = robot.stop_RAPID().status_code
    return {"before": before, "stop": stopped, "after": robot.get_exec_state(), "runs": robot.is_running()}


if __name__ == "__main__":
    sys.stdout.write(json.dumps({"rws1": rws1, "rws2": rws2}[sys.argv[2]](int(sys.argv[1]))) + "\n")
