"""The dialect of a program, by its name's ending, and whether the robot understands it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm import Robot
from calib.errors import DataError
from service.programs.fanuc import FanucProgram
from service.programs.frames import KnownFrames
from service.programs.kuka import KukaProgram
from service.programs.program import RobotProgram
from service.programs.rapid import RapidProgram
from service.programs.target_table import TargetTable, without_formulas
from service.programs.text import read_text
from service.programs.urscript import UrScript
from service.programs.val3 import Val3Data
from service.programs.yaskawa import YaskawaJob

RAPID, FANUC, URSCRIPT, TABLE = "RAPID module", "Fanuc program", "URScript", "target table"
KUKA, YASKAWA, VAL3 = "KUKA program", "Yaskawa job", "VAL3 data file"
SUFFIXES = {
    ".mod": RAPID,
    ".modx": RAPID,
    ".sys": RAPID,
    ".prg": RAPID,
    ".ls": FANUC,
    ".script": URSCRIPT,
    ".urscript": URSCRIPT,
    ".src": KUKA,
    ".dat": KUKA,
    ".jbi": YASKAWA,
    ".dtx": VAL3,
    ".csv": TABLE,
}
_MAKERS = {
    RAPID: "abb",
    FANUC: "fanuc",
    URSCRIPT: "universal robots",
    KUKA: "kuka",
    YASKAWA: "yaskawa",
    VAL3: "staubli",
}


def dialect_of(path: Path, robot: Robot) -> str:
    """Return the dialect of a file.

    Raises
    ------
    DataError
        The ending is unknown, or the dialect is that of another maker's robots.
    """
    dialect = SUFFIXES.get(path.suffix.lower())
    if dialect is None:
        raise DataError(
            "is not a program known here.", do=f"Its name must end in {', '.join(SUFFIXES)}.", file=path
        )
    maker = robot.maker.casefold()
    maker = maker.replace("ä", "a").replace("motoman", "yaskawa")
    speaks = [d for d, name in _MAKERS.items() if maker.startswith(name)]
    if dialect != TABLE and speaks and dialect not in speaks:
        raise DataError(
            f"is a {dialect}, and the model is of {robot.name} by {robot.maker}.",
            do="Use the model of the robot that runs the program.",
            file=path,
        )
    if dialect != TABLE and robot.joints != 6:
        raise DataError(
            f"is a {dialect}, and the robot has {robot.joints} joints.", do="Use a target table.", file=path
        )
    return dialect


def parse(text: str, path: Path, robot: Robot, known: KnownFrames) -> RobotProgram:
    """Parse a program from its text.

    Raises
    ------
    DataError
        The program cannot be read.
    """
    dialect = dialect_of(path, robot)
    if dialect == TABLE:
        return TargetTable(text, str(path), robot, known)
    if dialect == YASKAWA:
        return YaskawaJob(text, str(path), known)
    if dialect == VAL3:
        return Val3Data(text, str(path))
    world = np.eye(4)
    world[:3, 3] = robot.controller_world_mm
    reader = {RAPID: RapidProgram, FANUC: FanucProgram, URSCRIPT: UrScript, KUKA: KukaProgram}[dialect]
    return reader(text, str(path), world, known)


def as_written(text: str, path: Path) -> str:
    """Return a program's text for the file of this name.

    A table, which spreadsheets open, holds no formula.
    """
    return without_formulas(text) if SUFFIXES.get(path.suffix.lower()) == TABLE else text


def read_program(path: Path, robot: Robot, known: KnownFrames) -> RobotProgram:
    """Read a program file.

    Raises
    ------
    DataError
        The file cannot be read.
    """
    dialect_of(path, robot)
    return parse(read_text(path), path, robot, known)
