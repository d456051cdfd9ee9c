"""The declaration of the driver of Creaform's C-Track, not run against hardware yet."""

from __future__ import annotations

from dataclasses import replace

from drivers.bridge.details import battery_of, clock_of
from drivers.creaform.ctrack import LEAST_ON_BODY, LEAST_ON_REFERENCE, REFERENCE, CTrack
from drivers.declaration import InstrumentDriver, Option
from drivers.details import Details
from drivers.interfaces import InstrumentStatus

_MOST = 1000.0  # targets of a body


def _details(device: CTrack, status: InstrumentStatus) -> Details:
    """Return the battery charge of the C-Track and the bodies that it knows (MODELS)."""
    reply = device.session.ask("MODELS", {})
    names, totals = (reply.fields.get(key, "").split(",") for key in ("names", "totals"))
    bodies = {name: int(total) for name, total in zip(names, totals, strict=False) if total.isdecimal()}
    return replace(
        battery_of(device, status), bodies=bodies, reference=(REFERENCE, device.least_on_reference)
    )


DRIVERS = (
    InstrumentDriver(
        name="ctrack",
        maker="Creaform",
        instrument="ctrack",
        make=CTrack,
        options=(
            Option("min_visible", low=LEAST_ON_BODY, high=_MOST, default=LEAST_ON_BODY),
            Option("min_visible_base", low=LEAST_ON_BODY, high=_MOST, default=LEAST_ON_REFERENCE),
        ),
        cone_deg=15.0,  # flat reflectors seen by cameras
        details=_details,
        clock_s=clock_of,
    ),
)
