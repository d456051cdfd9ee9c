"""Files as people export them, read by a map of their columns: the map proposed, kept, and applied.

`files` reads cells and finds the table, `meanings` says what its columns are, `proposal` proposes the map and asks
what is open, `map` keeps it, `readings` applies it; `convert` goes the whole way from files and a map to a data set.
"""

from calib.foreign.convert import Converted, converted, data_set_of
from calib.foreign.map.map_file import Map, read_map, text_of
from calib.foreign.meanings.assigned import Finding, Question
from calib.foreign.proposal.proposal import propose
from calib.foreign.proposal.proposed import Part, Proposal

__all__ = [
    "Converted",
    "Finding",
    "Map",
    "Part",
    "Proposal",
    "Question",
    "converted",
    "data_set_of",
    "propose",
    "read_map",
    "text_of",
]
