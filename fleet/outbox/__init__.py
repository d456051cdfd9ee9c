"""The outbox of a cell: documents wait in a file until the fleet's server has them."""

from fleet.outbox.folder import Cell, collect, read_data, read_result
from fleet.outbox.link import Answer, Link
from fleet.outbox.queue import FILE, LARGEST, Entry, Outbox
from fleet.outbox.sender import Round, Sender

__all__ = [
    "FILE",
    "LARGEST",
    "Answer",
    "Cell",
    "Entry",
    "Link",
    "Outbox",
    "Round",
    "Sender",
    "collect",
    "read_data",
    "read_result",
]
