"""Files of other programs, read with a map of their columns.

The map is proposed, saved and applied. `files` reads cells and finds the table. `meanings` finds the
meaning of its columns. `proposal` proposes the map and asks open questions, `map` reads and writes it,
and `readings` applies it. `convert` makes a data set from files and a map.
"""

from calib.foreign.convert import Converted, converted, data_set_of
from calib.foreign.map.map_file import Map, read_map, text_of
from calib.foreign.meanings.assigned import ColumnFinding, ColumnQuestion, answers_of
from calib.foreign.proposal.proposal import MapProposal, TableProposal, propose

__all__ = [
    "ColumnFinding",
    "ColumnQuestion",
    "Converted",
    "Map",
    "MapProposal",
    "TableProposal",
    "answers_of",
    "converted",
    "data_set_of",
    "propose",
    "read_map",
    "text_of",
]
