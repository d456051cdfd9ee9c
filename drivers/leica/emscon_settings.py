"""The settings of an emScon tracker that affect its points, and reports of their changes.

They belong to the tracker and not to a connection: settings that another program left or changes act on the points of
this one. A transformation moves and scales the points, weather that is not applied corrects no distance, another
reflector shifts the end of the beam. Arming therefore sets them, and a change that is reported later disarms. The
measuring time only affects the noise. Order of the nine and codes of changes: ES_C_API_Def.h of the TPI,
SystemSettingsDataT, ES_SystemStatusChange.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import NotReady

_CORRECTS = 2  # the weather station is read and its refraction is used
# The nine in their order, with the required value, None for any.
_NEEDED: dict[str, int | None] = {
    "weather correction": _CORRECTS,
    "transformation": 0,
    "station orientation": 0,
    "keep last position": None,
    "telling of changes": 1,
    "sending of positions": 0,
    "try mode": 0,
    "nivel": None,
    "video camera": None,
}
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
    """Return the nine settings with the required values; settings without one are kept.

    Required are those on which points depend.
    """
    return tuple(
        was if wanted is None else wanted for was, wanted in zip(settings, _NEEDED.values(), strict=True)
    )


def can_be(settings: Sequence[int]) -> bool:
    """Check that these nine are settings and not damaged: they are small numbers."""
    return all(0 <= each <= _CORRECTS for each in settings)


def put_in_order(settings: Sequence[int]) -> str:
    """Return the names of the settings that `needed` changes."""
    changed = zip(_NEEDED, settings, needed(settings), strict=True)
    return ", ".join(name for name, before, after in changed if before != after)


def meddled(changes: Sequence[int]) -> NotReady | None:
    """Return the error for changes by another program since the arming, or None."""
    names = sorted({_CHANGES[code] for code in changes if code in _CHANGES})
    if not names:
        return None
    return NotReady(f"another program changed {', '.join(names)} of the tracker", what_to_do=_CLOSE)
