"""The software of a UR controller: services it can close, and where a person opens them.

Software 3 is a CB3, 5 an e-Series with PolyScope 5, 10 PolyScope X. From 5.10 on, PolyScope can close each interface as
a service. From 5.17 on, a new controller has all of them closed, and an update leaves them as they were. PolyScope X
has them closed too, and no dashboard. Its successor is the Robot API from 10.11 on (`drivers.ur.robot_api`). An
e-Series accepts programs only under remote control; PolyScope X has that mode in its safety overview.

Sources: Universal Robots, "Secure setup of UR cobots" (5.10), "Securely enable external access to services on UR
cobots" (5.17), manual of software 10.12, "Remote Mode in Safety Overview". For PolyScope X, issue 240 of
UniversalRobots/Universal_Robots_Client_Library; its `doc/setup/robot_setup.rst` and `doc/architecture`.
"""

from __future__ import annotations

RTDE = "Real-Time Data Exchange (RTDE)"
PRIMARY = "Primary Client Interface"
SECONDARY = "Secondary Client Interface"
REALTIME = "Real-Time Client Interface"
DASHBOARD = "Dashboard Server"

Software = tuple[int, ...]
"""Major, minor, bug fix, build, if known."""

E_SERIES: Software = (5,)
POLYSCOPE_X: Software = (10,)
_CAN_CLOSE: Software = (5, 10)
_MENU = "Settings > Security > Services"


def software_of(text: str) -> Software | None:
    """Return the software of a version such as `5.11.1`, None if it is no version."""
    parts = text.split(".")
    return tuple(map(int, parts)) if len(parts) > 1 and all(map(str.isdecimal, parts)) else None


def named(software: Software) -> str:
    """Return the name of the software, such as `PolyScope X 10.12`."""
    generation = "PolyScope X" if software >= POLYSCOPE_X else "PolyScope"
    return f"{generation} {'.'.join(map(str, software[:2]))}"


def can_close(software: Software | None) -> bool:
    """Check whether this software can close its interfaces, as an unknown one may."""
    return software is None or software >= _CAN_CLOSE


def where_enabled(service: str, software: Software | None) -> str:
    """Return where a person enables a service that is closed, as a sentence."""
    if software is None:
        return f"On a UR from PolyScope 5.10 or with PolyScope X: enable {service} in {_MENU}."
    if service == DASHBOARD and software >= POLYSCOPE_X:
        return "PolyScope X has no Dashboard Server."
    if not can_close(software):
        return f"{named(software)} does not close it: look for a firewall in between, or wait until it has started."
    return (
        f"On this controller ({named(software)}): menu in the corner (three bars) > {_MENU}, unlock with the "
        f"administrator's password, enable {service}."
    )


def where_remote(software: Software | None) -> str:
    """Return where a person switches the controller to remote control, as a sentence."""
    where = ""
    if software is not None and software >= POLYSCOPE_X:
        where = ": open the safety overview, tap Mode Selection, choose Automatic, then Remote"
    elif software is not None and software >= E_SERIES:
        where = (
            ": tap Local in the upper right corner and choose Remote Control "
            "(allowed once in Settings > System > Remote Control)"
        )
    return f"Switch the controller to remote control on the pendant{where}."
