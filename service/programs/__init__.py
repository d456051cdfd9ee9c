"""Robot programs: read, corrected, written back with all other text untouched.

`read_program` and `compensate` are the doors; a dialect is one file.
"""

from service.programs.compensation import Compensation, compensate
from service.programs.frames import KnownFrames, named_frames, pulses_of
from service.programs.program import rewritten
from service.programs.read import parse, read_program
from service.programs.text import write_text

__all__ = [
    "Compensation",
    "KnownFrames",
    "compensate",
    "named_frames",
    "parse",
    "pulses_of",
    "read_program",
    "rewritten",
    "write_text",
]
