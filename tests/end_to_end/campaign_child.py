"""Child process that is killed: it creates or resumes a campaign.

It prints a line for every durable reading.

python campaign_child.py create|resume RECORD CELL CAMPAIGN PORTS

PORTS: where the simulated devices listen, JSON by name.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from acquisition import Event, Run, read_campaign, read_cell
from service.simulated_cell import SimulatedDevices


def tell(event: Event) -> None:
    """One line an acknowledged reading of a pose, and one when the devices are in use."""
    if event.kind == "state" and event.data["state"] == "running":
        sys.stdout.write("running\n")
    elif event.kind == "reading":
        sys.stdout.write(f"reading {event.data['attempt']} {event.data['pose']} {event.data['set']}\n")
    sys.stdout.flush()


def main(verb: str, record: str, cell: str, campaign: str, ports: str) -> int:
    if verb == "create":
        run = Run.create(Path(record), read_cell(Path(cell)), read_campaign(Path(campaign)), simulated=True)
    else:
        run = Run.open(Path(record))
        run.resume(by="child")
    with run:
        outcome = run.execute(SimulatedDevices(json.loads(ports)).open(run.cell), on_event=tell)
    sys.stdout.write(f"{outcome.state.value} {outcome.reason}\n")
    return outcome.exit_code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
