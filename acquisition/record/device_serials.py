"""The robot and the instrument of a record: maker, model and serial number.

The devices report these themselves. They are recorded at the first connection, before anything moves, and compared at
every later connection. A robot may be exchanged while the cable is out, and every robot has its own errors. Another
device is refused unless a person accepts it by its serial number and gives a reason. The reason is kept, and readings
of each pair of robot and instrument are a separate series (`series_of`). A fact that a device does not report proves
nothing; once it is reported, it is recorded. Software may be updated, and is not compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from acquisition.errors import OtherIndividual
from acquisition.record.store import RecordStore
from drivers.errors import ConfigError
from drivers.interfaces import Identity

ROLES = ("robot", "instrument")
_COMPARED = ("maker", "model", "serial")


@dataclass(frozen=True)
class DeviceAcceptance:
    """A person's decision to accept another device than the record's.

    `serial` is its serial number, or its model if it reports none.
    """

    serial: str
    reason: str
    by: str = ""

    def __post_init__(self) -> None:
        if not self.serial.strip() or not self.reason.strip():
            raise ConfigError(
                "another device is accepted by its serial number and for a reason, one of which is missing",
                what_to_do="Give both; the reason is kept and is in the report.",
            )

    def names(self, who: Identity | Individual) -> bool:
        """Check that this serial number or model means the device."""
        return _plain(self.serial) == _plain(who.serial or who.model)


@dataclass(frozen=True)
class Individual:
    """One robot or instrument.

    `reason` states why it was accepted although the record has another; it is empty for the first.
    """

    role: str
    maker: str
    model: str
    serial: str
    firmware: str
    protocol: str
    accepted_by: str = ""
    reason: str = ""

    @classmethod
    def of(cls, role: str, who: Identity, accepted: DeviceAcceptance | None = None) -> Individual:
        """Return the device that reported `who`.

        `accepted` states by whom and why it was accepted, if the record has another one.
        """
        by, reason = ("", "") if accepted is None else (accepted.by, accepted.reason)
        return cls(role, who.maker, who.model, who.serial, who.firmware, who.protocol, by, reason)

    def is_other_than(self, who: Identity | Individual) -> bool:
        """Check whether both report something and it differs.

        A serial number may equal the alias of the other.
        """
        if isinstance(who, Identity) and who.alias and _plain(who.alias) == _plain(self.serial):
            who = replace(who, serial=self.serial)
        mine, its = ([_plain(getattr(each, name)) for name in _COMPARED] for each in (self, who))
        return any(a and b and a != b for a, b in zip(mine, its, strict=True))

    def refuse_other(self, who: Identity) -> None:
        """Raise OtherIndividual if a device other than this one answers.

        A model of this device will judge the readings.
        """
        if self.is_other_than(who):
            raise OtherIndividual(
                f"another {self.role} answers: {_words(who)}, but the model is of {self}",
                serial=who.serial or who.model,
                device=self.role,
                command="identify",
                what_to_do=f"Give the model of this {self.role}, or connect the one of the model.",
            )

    def why(self) -> str:
        """Return a clause with the reason why a device was accepted although the record has another."""
        by = f" by {self.accepted_by}" if self.accepted_by else ""
        return f"{self.role} {self} was accepted{by} beside another: {self.reason}"

    def __str__(self) -> str:
        return _words(self)


class Individuals:
    """The individual devices of one record."""

    def __init__(self, store: RecordStore) -> None:
        self._store = store

    def all(self) -> dict[int, Individual]:
        """Return the devices by their number in the record, in the order of their first connection."""
        rows = self._store.database.query("SELECT * FROM device ORDER BY id")
        names = [each.name for each in fields(Individual)]
        return {row["id"]: Individual(**{name: row[name] for name in names}) for row in rows}

    def now(self) -> dict[str, Individual]:
        """Return the device of each role that was met last."""
        return {each.role: each for each in self.all().values()}

    def expect(self, others: Sequence[Individual]) -> None:
        """Expect the devices of another record in this one, before anything is measured."""
        with self._store.changing():
            for each in others:
                self._write(Individual(**asdict(each) | {"accepted_by": "", "reason": ""}))

    def need(self, individual: Individual) -> None:
        """Allow motion with this device only, even if a person accepts another.

        A model of this device will judge the readings.
        """
        self._store.add_event("device_needed", **asdict(individual))

    def met(self, role: str, who: Identity, accepted: DeviceAcceptance | None) -> None:
        """Compare a device that has just been connected with the record, and note it.

        Raises
        ------
        OtherIndividual
            It is neither the record's nor accepted, or not the one that is needed.
        """
        for needed in map(individual_of, self._store.data_of_events("device_needed")):
            if needed.role == role:
                needed.refuse_other(who)
        known = self.now().get(role)
        if known is not None and self._told_both(role, known, who):
            who = replace(who, serial=known.serial)
        if known is None:
            self._write(Individual.of(role, who))
        elif not known.is_other_than(who):
            self._complete(known, who)
        elif accepted is not None and accepted.names(who):
            other = Individual.of(role, who, accepted)
            with self._store.changing() as db:
                self._write(other)
                self._store.note(
                    db,
                    "other_device_accepted",
                    role=role,
                    was=str(known),
                    now=str(other),
                    by=accepted.by,
                    reason=accepted.reason,
                )
        else:
            raise OtherIndividual(
                f"another {role} answers: {_words(who)}, but the record was measured with {known}",
                serial=who.serial or who.model,
                device=role,
                command="identify",
            )

    def _told_both(self, role: str, known: Individual, who: Identity) -> bool:
        """Check whether the serial of `known` and the alias of `who` were once reported together."""
        names = known.serial, who.alias
        told = self._store.data_of_events("connected")
        return all(names) and any(
            (each["role"], each["serial"], each.get("alias")) == (role, *names) for each in told
        )

    def _write(self, individual: Individual) -> None:
        values = asdict(individual)
        with self._store.changing() as db:
            (number,) = db.execute(
                f"INSERT INTO device ({', '.join(values)}) VALUES ({', '.join('?' * len(values))}) RETURNING id",
                tuple(values.values()),
            ).fetchone()
            self._store.seals.row(db, "device", number)

    def _complete(self, known: Individual, who: Identity) -> None:
        """Add facts that the device did not report before, and reports now."""
        added = {
            name: getattr(who, name) for name in _COMPARED if getattr(who, name) and not getattr(known, name)
        }
        if not added:
            return
        with self._store.changing() as db:
            (number,) = db.execute("SELECT max(id) FROM device WHERE role = ?", (known.role,)).fetchone()
            changes = ", ".join(f"{name} = ?" for name in added)
            db.execute(f"UPDATE device SET {changes} WHERE id = ?", (*added.values(), number))
            self._store.seals.row(db, "device", number)
            self._store.note(db, "device_told", role=known.role, **added)


def individuals_of(record: Path) -> dict[str, Individual]:
    """Return the robot and instrument that a record met last, by role.

    Raises
    ------
    RecordError
        There is no record.
    StorageError
        The record cannot be read.
    """
    store = RecordStore.open(record, writer=False)
    try:
        return Individuals(store).now()
    finally:
        store.close()


def series_of(robot: Individual | None, instrument: Individual | None) -> str:
    """Return the name of the series of these two devices: their serial numbers, if reported."""
    names = ((each.serial or each.model) if each else "" for each in (robot, instrument))
    return "+".join(re.sub(r"[^\w.-]+", "-", name) or role for name, role in zip(names, ROLES, strict=True))


def series_among(names: Iterable[str], devices: Mapping[str, Individual]) -> str:
    """Choose the series whose frames locate the readings of these devices.

    It is their own if it exists, otherwise the first.
    """
    known, own = list(names), series_of(*map(devices.get, ROLES))
    return own if own in known else known[0]


def header_table(individual: Individual, of_series: str) -> dict[str, str]:
    """Return the `[[device]]` table of a data set's header, without unknown values."""
    return {name: text for name, text in (asdict(individual) | {"series": of_series}).items() if text}


def individual_of(table: Mapping[str, Any]) -> Individual:
    """Return the device from a table that `header_table` wrote."""
    return Individual(**{each.name: str(table.get(each.name, "")) for each in fields(Individual)})


def _words(who: Identity | Individual) -> str:
    name = f"{who.maker} {who.model}".strip() or "a device that does not report its maker"
    return f"{name}, serial number {who.serial}" if who.serial else f"{name}, which reports no serial number"


def _plain(text: str) -> str:
    return "".join(text.split()).casefold()
