"""The settings of an emScon tracker on which its points depend, and the changes of them that it tells.

They belong to the tracker and not to a connection: whatever another program left there, or sets meanwhile, acts on the
points of this one. A transformation that is applied moves and scales them, a weather that is only read corrects no
distance, another reflector shifts the beam's end. So arming puts them in order, and a change that is told afterwards
disarms; the measuring time acts on noise alone. Order of the nine and codes of changes: ES_C_API_Def.h of the TPI,
SystemSettingsDataT, ES_SystemStatusChange.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import NotReady

_CORRECTS = 2  # the weather station is read and its refraction is used
# Weather, transformation, station, keep last position, tell changes, send positions, try, nivel, camera; None: any.
_NEEDED = (_CORRECTS, 0, 0, None, 1, 0, 0, None, None)
_CHANGES = {
    6: "units",
    7: "reflector",
    8: "system settings",
    11: "compensation",
    12: "coordinate system",
    15: "station",
    16: "transformation",
    17: "measurement mode",
}
_CLOSE = "Close the other program, see that the tracker knows the SMR that is seated, then confirm: it is set up anew."


def needed(settings: Sequence[int]) -> tuple[int, ...]:
    """The nine settings with those that points depend on put in order; the others stay as they are."""
    return tuple(was if wanted is None else wanted for was, wanted in zip(settings, _NEEDED, strict=True))


def meddled(changes: Sequence[int]) -> NotReady | None:
    """The error for changes that somebody else made since the tracker was armed; None where there is none."""
    names = sorted({_CHANGES[code] for code in changes if code in _CHANGES})
    if not names:
        return None
    return NotReady(f"another program changed {', '.join(names)} of the tracker", what_to_do=_CLOSE)
