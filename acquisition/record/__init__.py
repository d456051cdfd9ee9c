"""The record of a campaign: durable, sealed row by row, with functions that read it."""

from acquisition.record.database import FILE, LOCK, is_begun, is_owned, sha256_of
from acquisition.record.device_serials import DeviceAcceptance, individual_of
from acquisition.record.export import export, export_events, planned_header
from acquisition.record.merge import export_together
from acquisition.record.rescue import rescue, salvage
from acquisition.record.states import State
from acquisition.record.store import Event, RecordStore
from acquisition.record.streams import export_streams
from acquisition.record.verification import Verification

__all__ = [
    "FILE",
    "LOCK",
    "DeviceAcceptance",
    "Event",
    "RecordStore",
    "State",
    "Verification",
    "export",
    "export_events",
    "export_streams",
    "export_together",
    "individual_of",
    "is_begun",
    "is_owned",
    "planned_header",
    "rescue",
    "salvage",
    "sha256_of",
]
