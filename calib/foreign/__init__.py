"""Files as people export them, read by a map of their columns: the map proposed, kept, and applied.

`sheet` and `workbook` read cells, `layout` finds the table, `words` and `assignment` say what its columns are,
`proposal` what is
open, `map_file` keeps it, `readings` applies it, `matching` joins two files, `evidence` asks the nominal robot.
"""

from calib.foreign.assigned import Finding, Question
from calib.foreign.convert import Converted, converted
from calib.foreign.map_file import Map, read_map, text_of
from calib.foreign.proposal import propose
from calib.foreign.proposed import Part, Proposal

__all__ = [
    "Converted",
    "Finding",
    "Map",
    "Part",
    "Proposal",
    "Question",
    "converted",
    "propose",
    "read_map",
    "text_of",
]
