"""The table of a device in a cell file, and `[instrument]`: the instrument, its place and its noise."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, GetJsonSchemaHandler, Strict, create_model, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from acquisition.file_table import ADD, Place, Table, Text, Written, no_default, refused, told
from drivers import (
    INSTRUMENTS,
    InstrumentDriver,
    NumbersOption,
    Option,
    RobotDriver,
    TextOption,
    instrument_driver,
)
from drivers.errors import ConfigError


class DeviceSection(Table):
    """The table of a device: its driver decides on further keys.

    Attributes
    ----------
    of_driver
        The driver, once it is known.
    """

    drivers: ClassVar[Mapping[str, RobotDriver] | Mapping[str, InstrumentDriver]]
    of_driver: ClassVar[RobotDriver | InstrumentDriver | None] = None

    driver: Annotated[Text, told("Name of the driver.", next(iter(INSTRUMENTS)))]
    url: Annotated[
        Written,
        told(
            "Address of the device, `tcp://HOST:PORT` or another form that the driver reads; must be given, except "
            "with `manual`. `--simulate` replaces it.",
            "tcp://192.168.125.1:5000",
            json_schema_extra=no_default,
        ),
    ] = ""

    @property
    def options(self) -> dict[str, Any]:
        """The values of the keys that only the driver uses, as far as they are given."""
        known = () if self.of_driver is None else self.of_driver.options
        found = {option.key: vars(self)[option.key] for option in known}
        return {key: value for key, value in found.items() if value is not None}

    def __reduce__(self) -> tuple[Any, ...]:
        """Let another process find the class, which was made for the driver."""
        base = type(self) if self.of_driver is None else type(self).__bases__[0]
        return _blank, (base, self.driver), self.__getstate__()

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the schema with the keys of all drivers of this program."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        for driver in cls.drivers.values() if cls.of_driver is None else ():
            own = for_driver(cls, driver).model_json_schema()["properties"]
            known = handler.resolve_ref_schema(schema)["properties"]
            known.update({option.key: own[option.key] for option in driver.options})
        return schema


def _blank(base: type[DeviceSection], driver: str) -> DeviceSection:
    table = base.of({"driver": driver})
    return table.__new__(table)


Device = TypeVar("Device", bound=DeviceSection)


@cache
def for_driver(base: type[Device], driver: RobotDriver | InstrumentDriver) -> type[Device]:
    """Return the table of a device with the keys of its driver."""
    fields: dict[str, Any] = {option.key: _field(option, driver) for option in driver.options}
    if not driver.by_hand:
        fields["url"] = Annotated[Text, told(base.model_fields["url"].description or "", "")], ...
    known: Any = ClassVar[RobotDriver | InstrumentDriver], driver
    return create_model(base.__name__, __base__=base, of_driver=known, **fields)


def _field(
    option: Option | TextOption | NumbersOption, driver: RobotDriver | InstrumentDriver
) -> tuple[Any, Any]:
    """Return type and default of the key of an option."""
    if isinstance(option, NumbersOption):
        assert isinstance(driver, RobotDriver)
        each = Annotated[float, Field(gt=0.0)]
        count = Field(min_length=driver.joints, max_length=driver.joints)
        return Annotated[
            tuple[each, ...], Strict(False), count, told(option.words, [1000.0] * driver.joints)
        ], ...
    if isinstance(option, TextOption):
        one_of: Any = Literal
        kind: Any = one_of[option.allowed] if option.allowed else Text
        return Annotated[kind | None, told(option.words, option.default)], None
    words = told(option.words, option.default, ge=option.low, le=option.high)
    return (Annotated[float, words], ...) if option.needed else (Annotated[float | None, words], None)


class NoiseFigures(Table):
    """Declared noise of an instrument, 1 sigma.

    Points in mm and in ppm of the distance, rotations in mrad, lengths in mm.
    """

    range_mm: Annotated[float, told("Noise along the beam, 1 sigma, mm.", 0.005, ge=0.0)] = 0.010
    range_ppm: Annotated[float, told("Its share of the distance, added, ppm.", 1.0, ge=0.0)] = 2.0
    transverse_mm: Annotated[float, told("Noise across the beam, per axis, mm.", 0.005, ge=0.0)] = 0.010
    transverse_ppm: Annotated[float, told("Its share of the distance, added, ppm.", 2.5, ge=0.0)] = 6.0
    rotation_mrad: Annotated[float, told("Noise of orientations, mrad; 0: not fitted.", 0.05, ge=0.0)] = 0.0
    length_mm: Annotated[float, told("Noise of distances, mm; only for a ballbar.", 0.001, ge=0.0)] = 0.0005


class InstrumentSection(DeviceSection, NoiseFigures):
    """The instrument of the cell.

    A ballbar has no station and no other noise than that of lengths.
    """

    drivers = INSTRUMENTS

    driver: Annotated[Text, told(f"Name of the driver: {', '.join(INSTRUMENTS)}.", next(iter(INSTRUMENTS)))]
    station_mm: Annotated[
        Place,
        told(
            "Position of the instrument in the world frame, mm; must be given, except of a ballbar.",
            [2400.0, -900.0, 350.0],
            json_schema_extra=no_default,
        ),
    ] = (0.0, 0.0, 0.0)
    one_smr: Annotated[bool, told("A person moves the only SMR from nest to nest.", True)] = False
    expected_within_mm: Annotated[
        float,
        told("A target seen farther than this from its place is not accepted, mm.", 20.0, ge=1.0, le=1e4),
    ] = 50.0

    if TYPE_CHECKING:
        nominal_mm: float  # a key of drivers of ballbars

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> type[Self]:
        if cls.of_driver is not None or not isinstance(name := values.get("driver"), str):
            return cls
        try:
            return for_driver(cls, instrument_driver(name))
        except ConfigError as error:
            raise refused("driver", f"{error.message}.", "Name one of them.") from error

    @classmethod
    def accepted(cls) -> Collection[str]:
        if cls.of_driver is None:
            return cls.model_fields
        return cls.model_fields.keys() - ({"length_mm"} if _measures_points(cls.of_driver) else _OF_POINTS)

    @model_validator(mode="before")
    @classmethod
    def _has_its_station(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "station_mm" not in values and _measures_points(cls.of_driver):
            raise refused("station_mm", "is missing.", ADD)
        return values

    @property
    def name(self) -> str:
        """Its name in data sets."""
        return self.declared.instrument

    @property
    def noise(self) -> NoiseFigures:
        return self

    @property
    def declared(self) -> InstrumentDriver:
        """The declaration of its driver."""
        return instrument_driver(self.driver)


_OF_POINTS = {*NoiseFigures.model_fields, "station_mm", "one_smr", "expected_within_mm"} - {"length_mm"}


def _measures_points(driver: RobotDriver | InstrumentDriver | None) -> bool:
    return isinstance(driver, InstrumentDriver) and not driver.measures_lengths
