"""The cell: which robot and instrument, where, and what arm and tool must keep clear of."""

from acquisition.cell.cell import Cell, cell_from, cell_of_record, read_cell
from acquisition.cell.devices import Devices, open_devices
from acquisition.cell.position_uncertainty import unstated_in_words

__all__ = [
    "Cell",
    "Devices",
    "cell_from",
    "cell_of_record",
    "open_devices",
    "read_cell",
    "unstated_in_words",
]
