"""Campaigns on the simulated cell: devices speak their wire protocols in a separate process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import acquisition
from acquisition import Event, Run, read_campaign, read_cell
from acquisition.errors import RecordError
from acquisition.record import State
from calib.fit import silent
from service.simulated_cell import simulated_cell
from truepose.data import Data, read


def simulate(
    cell: str | Path,
    campaign: str | Path,
    record: str | Path,
    *,
    progress: Callable[[str], None] | None = None,
) -> Data:
    """Measure a campaign on the simulators of its cell and read its data set.

    Prompts are answered if the cell file says `[simulation] operator = "confirms"`.

    Parameters
    ----------
    cell, campaign :
        Files of the cell and the campaign.
    record :
        New folder, for the durable record and `data.csv`, `data.toml`.
    progress :
        Called with the text of each step.

    Raises
    ------
    ConfigError, UnsafePlan
        A file cannot be used, or the plan is unsafe.
    RecordError
        The record cannot be created, or the campaign did not finish.
    AcquisitionError
        Fault for which the campaign paused.

    >>> truepose.simulate("cell.toml", "campaign.toml", "record")
    <data.csv: 4 readings of abb-irb120, 4 to fit, 0 to validate>
    """
    say = progress or silent
    folder = Path(record)

    def listen(event: Event) -> None:
        say(event.kind.replace("_", " "))

    with Run.create(folder, read_cell(Path(cell)), read_campaign(Path(campaign)), simulated=True) as run:
        say("starting the simulators of the cell")
        with simulated_cell(run.cell) as simulators:
            outcome = run.execute(simulators.open(run.cell), on_event=listen)
    if outcome.error is not None:
        raise outcome.error
    if outcome.state is not State.SUCCEEDED:
        raise RecordError(f"{folder}: {outcome.reason}", what_to_do="Resume it on the command line.")
    return read(acquisition.export(folder, folder / "data.csv"))
