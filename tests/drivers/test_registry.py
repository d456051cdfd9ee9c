"""The table of drivers: each driver declares its name, and a device is opened by that name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import drivers
from drivers import (
    INSTRUMENTS,
    ROBOTS,
    ConfigError,
    InstrumentDriver,
    RobotDriver,
    open_instrument,
    open_robot,
)

ROOMS = Path(__file__).parents[2]
DRIVERS: list[RobotDriver | InstrumentDriver] = [*ROBOTS.values(), *INSTRUMENTS.values()]


def test_every_folder_of_a_maker_is_in_the_table() -> None:
    folders = {path.parent.name for path in (ROOMS / "drivers").glob("*/declaration.py")}
    assert folders == {driver.make.__module__.split(".")[1] for driver in DRIVERS}


@pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver.name)
def test_only_its_folder_knows_a_driver_by_its_name(driver: RobotDriver | InstrumentDriver) -> None:
    """Exceptions are the rehearsal, with an ABB and a FARO, and `manual`, a controller mode too."""
    rooms = [ROOMS / "acquisition", ROOMS / "service" / "commands", ROOMS / "service" / "http"]
    files = [path for room in rooms for path in room.rglob("*.py") if path.stem != "rehearsal"]
    files += (ROOMS / "drivers").glob("*.py")
    assert len(files) > 50
    if driver.by_hand:
        files = [path for path in files if path.name not in ("interfaces.py", "robot.py", "prompt_routes.py")]
    assert [path.name for path in files if f'"{driver.name}"' in path.read_text("utf-8")] == []


@pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver.name)
def test_it_says_until_hardware_was_tried_that_it_was_not(driver: RobotDriver | InstrumentDriver) -> None:
    assert driver.make.unverified_on_hardware  # type: ignore[attr-defined]


@pytest.mark.parametrize("opened", [open_robot, open_instrument])
def test_unknown_driver(opened: Callable[[str, str], object]) -> None:
    with pytest.raises(ConfigError, match="unknown; there are"):
        opened("kuka", "tcp://h:1")


def test_the_public_face_names_what_it_has() -> None:
    assert sorted(set(drivers.__all__)) == sorted(drivers.__all__)
    assert all(hasattr(drivers, name) for name in drivers.__all__)
