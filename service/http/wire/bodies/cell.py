"""The bodies of the service, the cell, its lease, campaigns and data sets."""

from __future__ import annotations

from typing import Annotated, Literal

from acquisition.run import DeviceCondition
from service.http.wire.bodies.fields import Created, Id, Name, ResponseBody, Simulated, told
from service.results.common import Campaign
from service.results.files.conversion import MappedFit, ProposalResult


class Health(ResponseBody):
    """The service answers."""

    status: Annotated[Literal["ok"], told("It answers.", "ok")]
    version: Annotated[str, told("The version of the program.", "0.1.0")]
    page: Annotated[
        str, told("Hash of the operator's page: an open one of another hash is old.", "3f9a1c07b2e4")
    ]
    simulated: Simulated


class LeaseShown(ResponseBody):
    """The motion lease."""

    holder: Annotated[str, told("Who holds it.", "anna")]
    expires_utc: Annotated[
        str, told("When it ends unless it is prolonged, RFC 3339 UTC.", "2026-11-21T17:05:29.120Z")
    ]
    seconds: Annotated[float, told("For how long it was taken, s.", 30.0)]
    lease_id: Annotated[
        str,
        told(
            "Its secret, in the answer that grants it; empty ever after.", "mB0p2kq8J9yqk0Yd0F3J8V5cQv2m0f1x"
        ),
    ] = ""
    taken_from: Annotated[str, told("Who held it before it was taken over.", "")] = ""


class CellShown(ResponseBody):
    """The cell of this service."""

    name: Name
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    robot_driver: Annotated[str, told("The driver of the robot, as the cell file names it.", "my_robot")]
    instrument: Annotated[str, told("The instrument.", "faro-ion")]
    instrument_driver: Annotated[
        str, told("The driver of the instrument, as the cell file names it.", "my_tracker")
    ]
    targets: Annotated[list[str], told("Names of the targets on the tool.", ["T1", "T2", "T3"])]
    nests: Annotated[list[str], told("Names of the nests on the base.", ["N1", "N2", "N3"])]
    simulated: Simulated
    run_id: Annotated[str | None, told("The run that uses the robot.", None)]
    loop_id: Annotated[str | None, told("The loop that uses the robot.", None)]
    verification_id: Annotated[str | None, told("The verification that uses the robot.", None)] = None
    last_run_id: Annotated[
        str | None, told("The run that uses the robot, or used it last: perhaps it is paused.", None)
    ]
    role: Annotated[Literal["operator", "viewer"], told("That of the token that asks.", "operator")]
    lease: Annotated[LeaseShown | None, told("The motion lease; null: nobody holds it.", None)]


class DeviceShown(ResponseBody):
    """What is known of a device; nothing was asked for this answer."""

    role: Annotated[Literal["robot", "instrument"], told("Which device.", "instrument")]
    name: Annotated[str, told("The robot file's name, or the instrument.", "faro-ion")]
    driver: Annotated[str, told("Its driver, as the cell file names it.", "faro_ion")]
    state: Annotated[
        DeviceCondition,
        told(
            "`unknown`: nothing has asked it; `silent`: the link was lost. Trouble stays until it is asked again.",
            "beam_lost",
        ),
    ]
    says: Annotated[str, told("The same in words, with trouble also what to do.", "It measures T1.")]
    since_utc: Annotated[
        str | None, told("When that began, RFC 3339 UTC; null if unknown.", "2026-11-21T17:04:59.120Z")
    ]
    heard_utc: Annotated[
        str | None, told("When it last answered, RFC 3339 UTC; null: never.", "2026-11-21T17:05:01.004Z")
    ]
    code: Annotated[int | None, told("Number of the kind of error; no unit.", 2001)]


class DeviceList(ResponseBody):
    """The devices of the cell."""

    devices: Annotated[list[DeviceShown], told("The robot, then the instrument.", [])]


class ConnectionShown(ResponseBody):
    """A connection by which other programs read live values."""

    kind: Annotated[Literal["mqtt", "opcua"], told("Its protocol.", "mqtt")]
    address: Annotated[
        str, told("The broker, or where clients connect.", "mqtts://broker.plant.example:8883")
    ]
    state: Annotated[
        Literal["connecting", "connected", "listening", "failed"],
        told("`failed` and `connecting` are tried again by themselves.", "connected"),
    ]
    says: Annotated[
        str, told("The same in words, with trouble also what to do.", "The broker has the connection.")
    ]
    since_utc: Annotated[str, told("Since when, RFC 3339 UTC.", "2026-11-21T17:04:59.120Z")]


class ConnectionList(ResponseBody):
    """The connections by which other programs read live values."""

    connections: Annotated[list[ConnectionShown], told("Those that were asked for at the start.", [])]


class CampaignShown(ResponseBody):
    """A campaign that was kept."""

    id: Id
    name: Name
    created_utc: Created
    campaign: Annotated[
        Campaign, told("The campaign itself.", {"format": "truepose-campaign/1", "block": [{"count": 60}]})
    ]


class DatasetShown(ResponseBody):
    """A data set."""

    id: Id
    name: Name
    created_utc: Created
    run_id: Annotated[str | None, told("The run that it was exported from.", None)]
    simulated: Simulated
    sha256: Annotated[str, told("Hash of table and header.", "a93c6fe109b1ae11")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    instrument: Annotated[str, told("The instrument.", "faro-ion")]
    readings: Annotated[int, told("Number of readings.", 300)]
    fit: Annotated[int, told("Number of readings that take part in a fit.", 180)]
    validation: Annotated[int, told("Number of readings that only judge.", 120)]


class DatasetMapped(DatasetShown):
    """A data set that was created from foreign files by their map."""

    fit_of_robot: Annotated[MappedFit | None, told("Null: this cannot be said of these readings.", None)]
    said: Annotated[list[str], told("What was left aside or made of the files.", ["left aside: 'Remark'"])]


class TablePreview(ResponseBody):
    """The first rows of a table in a foreign file. The columns of a proposal are those of its tables, in order."""

    file: Annotated[str, told("Name of the file.", "messung.csv")]
    sheet: Annotated[str, told("Its sheet; empty: it has none.", "Tabelle1")]
    prefix: Annotated[
        str, told("What the key of an answer about it begins with: PREFIXcolumn.NAME=CHOICE.", "1.")
    ]
    names: Annotated[list[str], told("Names of the columns.", ["J1", "X [mm]"])]
    lines: Annotated[list[int], told("Line numbers of these rows in the file, from 1.", [3, 4])]
    rows: Annotated[
        list[list[str]], told("The cells of the first rows; long ones are cut off.", [["12.5", "880.1"]])
    ]
    readings: Annotated[int, told("Number of rows with readings.", 120)]


class MapProposalShown(ProposalResult):
    """A proposed map of uploaded files, as `truepose convert` proposes it, and what a person answers it by."""

    map_text: Annotated[
        str,
        told("The map as --propose writes it: complete, it goes to /datasets/mapped with the files.", "..."),
    ]
    tables: Annotated[list[TablePreview], told("The tables that were found.", [])]
    choices: Annotated[
        list[str],
        told("What an answer may say that a column is; `leave` leaves it aside.", ["leave", "j1", "x"]),
    ]
    robots: Annotated[list[str], told("The robots that may be named.", ["abb-irb120"])]


class Campaigns(ResponseBody):
    """Every campaign."""

    campaigns: Annotated[list[CampaignShown], told("Newest first.", [])]


class DatasetList(ResponseBody):
    """Every data set."""

    datasets: Annotated[list[DatasetShown], told("Newest first.", [])]
