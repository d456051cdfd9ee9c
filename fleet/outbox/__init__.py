"""The outbox of a cell: documents wait in a file until the fleet's server has them."""

from fleet.outbox.folder import CellFolder, collect, read_data, read_result
from fleet.outbox.link import ServerLink, UploadAnswer
from fleet.outbox.queue import FILE, LARGEST, Outbox, QueuedDocument
from fleet.outbox.sender import Sender, SendRound

__all__ = [
    "FILE",
    "LARGEST",
    "CellFolder",
    "Outbox",
    "QueuedDocument",
    "SendRound",
    "Sender",
    "ServerLink",
    "UploadAnswer",
    "collect",
    "read_data",
    "read_result",
]
