"""The recorder of streams.

It would catch a device that disarmed itself while its stream was closed because of another error, and that is not armed
again. The next attempt would be lost too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from acquisition import campaign_from
from acquisition.record import RecordStore
from acquisition.run.rig.recorder import Recorder
from acquisition.run.rig.rig import DevicePair
from drivers import Identity, LinkTimeout, MotionStopped, Sample
from tests.acquisition.fakes import a_cell


class Streaming:
    """Device whose stream gives nothing; with `fails`, closing the stream does not end."""

    can_stop = True

    def __init__(self, *, fails: bool) -> None:
        self.fails, self.armed_times = fails, 0

    def connect(self) -> None: ...

    def identify(self) -> Identity:
        return Identity("maker", "model", "serial", "1", "wire")

    def position(self) -> Any:
        return SimpleNamespace(joints_deg=(0.0,) * 6)

    def arm(self) -> None:
        self.armed_times += 1

    @contextmanager
    def stream(self, rate_hz: float) -> Iterator[Iterator[Sample | None]]:
        del rate_hz
        yield iter(lambda: None, 0)
        if self.fails:
            raise LinkTimeout("no complete answer", device="tracker", command="STREAM")


def test_what_disarmed_itself_at_the_end_of_a_failed_path_is_armed_again(tmp_path: Path) -> None:
    robot, tracker = Streaming(fails=False), Streaming(fails=True)
    devices = SimpleNamespace(robot=robot, instrument=tracker)
    control = SimpleNamespace(check_stop=lambda: None, stopping=False)
    rig = DevicePair(cast(Any, devices), cast(Any, control), lambda _: None)
    rig.make_ready()
    campaign = campaign_from({"format": "truepose-campaign/1", "block": [{"count": 10}]}, "campaign.toml")
    store = RecordStore.create(tmp_path, "cell", a_cell().source, campaign.source, [], simulated=True)
    rates = {"robot": 125.0, "instrument": 10.0}
    with pytest.raises(MotionStopped, match="stopped on its way"), Recorder(store, 1, rig, rates):
        raise MotionStopped("stopped on its way", device="robot", command="move_to")
    rig.make_ready()
    assert (robot.armed_times, tracker.armed_times) == (1, 2)
    with pytest.raises(LinkTimeout, match="no complete answer"), Recorder(store, 2, rig, rates):
        pass
    rig.make_ready()
    assert (robot.armed_times, tracker.armed_times) == (1, 3)
    store.close()
