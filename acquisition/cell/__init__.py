"""The cell: robot, instrument, their places, and the obstacles of arm and tool."""

from acquisition.cell.cell import Cell, cell_from, cell_of_record, read_cell, unstated_in_words
from acquisition.cell.devices import Devices, open_devices
from acquisition.cell.obstacles import Box, FloorObstacle, Obstacle, Post
from acquisition.cell.transit import Transit, home_of
from acquisition.cell.workspace import targets_at

__all__ = [
    "Box",
    "Cell",
    "Devices",
    "FloorObstacle",
    "Obstacle",
    "Post",
    "Transit",
    "cell_from",
    "cell_of_record",
    "home_of",
    "open_devices",
    "read_cell",
    "targets_at",
    "unstated_in_words",
]
