"""Tool and work frames in the file or on the screen of each maker.

The controller calculates with nominal kinematics. A tool frame and a work frame are what it takes from a model
besides joint offsets:

    real pose of a target in the world of the readings = W . B . FK(q) . F . target
    what the controller believes, in its work frame U  = U^-1 . C^-1 . FK(q) . T

FK is the nominal robot, C the place of the controller's world in the frame of the robot's base. B and F are the best
constants of the model at the base and at the flange, W is where the base is in the world of the readings. Both agree
for the tool T = F . target and the work frame

    `base`   U = C^-1 . B^-1 . C        for targets that are given in the controller's own world
    `world`  U = C^-1 . B^-1 . W^-1     for targets in the world of the readings

The tool `flange` is F alone: put it in front of your own tools.

Sources:

- ABB RAPID: `tooldata` and `wobjdata` of the maker's data types. Mass -1 is a load that is not yet defined.
- Fanuc TP: `PR[n]=P[m]`, `UTOOL[k]=PR[n]`, `UFRAME[k]=PR[n]`, three decimals, as in github.com/LeroyDu56/CrossArm
  (tests/fixtures/probes/maketp), whose programs the maker's ROBOGUIDE has loaded and run.
- KUKA: lines `TOOL_DATA[n]={X ..,C ..}`, `TOOL_NAME[n,]=".."` of `$config.dat`, as public post-processors read them.
- UR: `set_tcp` and `pose_trans` of the script manual.
- Yaskawa: TOOL.CND as in github.com/SinaiAranda/motoman_sda20d_sys, and the row `////BUSER` of UFRAME.CND. Rx, Ry, Rz
  turn in the order Rz, Ry, Rx (DX100 manual 156191-1CD, 4.3.1).
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm import Robot
from calib.array import Array
from calib.compensate import inverse_poses, poses_with, rigid_frames
from service.exports.request import ExportRequest, Format, for_maker
from service.programs import frames as notation

_METRE = 1000.0
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
_TOOL = tuple(f"tool.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
NOT_TRIED = (
    "Not tried on a real controller. Keep a backup, compare the numbers on the pendant, drive slowly and measure a "
    "point."
)


@dataclass(frozen=True)
class NamedFrame:
    """A frame with its name for people, its name or number in the controller, and its numbers."""

    name: str
    key: str
    numbers: tuple[str, ...]


@dataclass(frozen=True)
class FrameDialect:
    """Notation of frames in the controllers of a maker.

    Attributes
    ----------
    maker, called : str
        Beginning of the maker's name in robot files, and name for people.
    labels : tuple of str
        Names of the numbers of a frame.
    numbers : callable
        Returns the numbers of a pose (4, 4), mm, as they are written.
    pose : callable
        Returns the pose (4, 4) of such numbers, mm.
    keys : callable
        Returns the name or number in the controller of every tool, then of every work frame, by the names for people.
        Those that the controller has no place for are missing.
    file : callable
        Returns the file of tools and work frames below lines about it.
    tool, frame : str
        Patterns whose first group holds the numbers of the flange's tool, and of the work frame `base`, in the file.
    needs, of_file : tuple of str
        What people must know about this maker's frames, and about the file.
    """

    maker: str
    called: str
    labels: tuple[str, ...]
    numbers: Callable[[Array], tuple[str, ...]]
    pose: Callable[[Sequence[float]], Array]
    keys: Callable[[Sequence[str], Sequence[str]], tuple[Mapping[str, str], Mapping[str, str]]]
    file: Callable[[ExportRequest, Sequence[NamedFrame], Sequence[NamedFrame]], str]
    tool: str
    frame: str
    needs: tuple[str, ...] = ()
    of_file: tuple[str, ...] = ()

    def frames(self, export: ExportRequest) -> tuple[list[NamedFrame], list[NamedFrame]]:
        """Return the tools and the work frames that the controller has a place for.

        The first tool is `flange`, the first work frame `base`.
        """
        tools, works = _poses(export)
        of_tools, of_works = self.keys(list(tools), list(works))
        made = [
            [NamedFrame(name, keys[name], self.numbers(pose)) for name, pose in poses.items() if name in keys]
            for poses, keys in ((tools, of_tools), (works, of_works))
        ]
        return made[0], made[1]

    def found(self, text: str, export: ExportRequest, *, listed: bool = False) -> tuple[Array, Array]:
        """Return what the frames of a file do, (4, 4) each, mm: at the base and at the flange.

        The frames are those of the maker's own file, or `listed` by the names of their numbers.
        """
        patterns = (r"^tool flange: (.*)$", r"^frame base: (.*)$") if listed else (self.tool, self.frame)
        flags = re.MULTILINE if listed else re.MULTILINE | re.DOTALL
        tool, frame = (_first(pattern, text, flags) for pattern in patterns)
        at = controller_world(export.robot)
        return at @ inverse_poses(self.pose(frame)) @ inverse_poses(at), self.pose(tool)


def _first(pattern: str, text: str, flags: re.RegexFlag) -> list[float]:
    found = re.search(pattern, text, flags)
    assert found is not None, f"the file lacks {pattern}"
    return [float(number) for number in _NUMBER.findall(found[1])]


def controller_world(robot: Robot) -> Array:
    """Return the pose (4, 4) of the controller's world in the frame of the robot's base, mm."""
    out = np.eye(4)
    out[:3, 3] = robot.controller_world_mm
    return out


def _poses(export: ExportRequest) -> tuple[dict[str, Array], dict[str, Array]]:
    base, flange = rigid_frames(export.robot, export.carried.values)
    at, mounting = controller_world(export.robot), export.mounting
    tools = {"flange": flange} | {
        name: flange @ pose for name, pose in mounting.tools.items() if name != "flange"
    }
    works = {"base": inverse_poses(base @ at) @ at}
    if mounting.world is not None:
        world = inverse_poses(mounting.world @ base @ at)
        if not np.allclose(world, works["base"], rtol=0.0, atol=1e-9):
            works["world"] = world
    return tools, works


def frame_notes(maker: FrameDialect, export: ExportRequest) -> tuple[str, ...]:
    """Return what people must know about the frames of an export."""
    mounting, robot = export.mounting, export.robot
    tools, _ = maker.frames(export)
    lines = [NOT_TRIED, *maker.needs]
    lines.append(
        f"For a controller that calculates with the kinematics of the robot file {robot.name}, absolute accuracy off."
    )
    left = [name for name in mounting.tools if name not in {each.name for each in tools}]
    if left:
        lines.append(f"The controller has no place for the tools {', '.join(left)}: they are left out.")
    if not mounting.tools:
        lines.append("The model has no tool target: the only tool is the corrected flange.")
    elif mounting.declared:
        lines.append(
            f"No reading determined the place of {', '.join(mounting.declared)}: it is the declared one."
        )
    if mounting.tools and not mounting.turned:
        lines.append("No reading determined the orientation of a tool: it is that of the flange.")
    if mounting.world is None:
        lines.append(
            "The readings do not determine where the base is (distances alone do not): there is no frame 'world'. "
            "The frame 'base' is for targets in the controller's own world."
        )
    return tuple(lines)


def frame_slots(robot: Robot) -> tuple[str, ...]:
    """Return the slots of a tool frame and a work frame."""
    del robot
    return (*_BASE, *_TOOL)


def _format(maker: FrameDialect) -> Format:
    def writes(export: ExportRequest) -> str:
        return maker.file(export, *maker.frames(export))

    def reads(text: str, export: ExportRequest) -> Array:
        base, flange = maker.found(text, export)
        return base @ poses_with(export.robot, export.carried.joints, {}) @ flange

    return Format(
        frame_slots,
        writes,
        reads,
        "tool frames and work frames",
        for_maker(maker.maker, maker.called),
        lambda export: (*frame_notes(maker, export), *maker.of_file),
    )


# -- text -------------------------------------------------------------------------------------------------


def plain(text: str) -> str:
    """Write a text in ASCII on one line: a controller may refuse others."""
    bare = unicodedata.normalize("NFKD", text).encode("ascii", "replace").decode("ascii")
    return " ".join("".join(c if c.isprintable() else " " for c in bare).split())


def comment(lines: Iterable[str], mark: str, width: int = 100) -> list[str]:
    """Wrap lines as comments that begin with `mark`."""
    return [
        f"{mark}{part}"
        for line in lines
        for part in textwrap.wrap(plain(line), width - len(mark), break_on_hyphens=False)
    ]


def identifiers(names: Sequence[str], prefix: str, most: int) -> dict[str, str]:
    """Return an identifier of at most `most` characters for each name.

    It has letters, digits and `_` after the prefix. Two that differ only in capitals count as the same to controllers;
    the later one gets a number.
    """
    out: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        bare = re.sub(r"\W", "_", plain(name), flags=re.ASCII)
        whole, count = f"{prefix}{bare}"[:most], 1
        while whole.casefold() in taken:
            count += 1
            tail = f"_{count}"
            whole = f"{prefix}{bare}"[: most - len(tail)] + tail
        taken.add(whole.casefold())
        out[name] = whole
    return out


def _named(tool: str, work: str, most: int) -> Callable[..., tuple[Mapping[str, str], Mapping[str, str]]]:
    return lambda tools, works: (identifiers(tools, tool, most), identifiers(works, work, most))


def _numbered(tools: int, works: int) -> Callable[..., tuple[Mapping[str, str], Mapping[str, str]]]:
    """Number from the last place downwards, because the first ones are in use."""

    def keys(named: Sequence[str], works_named: Sequence[str]) -> tuple[Mapping[str, str], Mapping[str, str]]:
        first, second = (
            {name: str(last - k) for k, name in enumerate(names) if k < last}
            for names, last in ((named, tools), (works_named, works))
        )
        return first, second

    return keys


def _fixed(values: Iterable[float], places: Sequence[int]) -> tuple[str, ...]:
    """Write numbers with a point and fixed places, no number as minus zero."""
    return tuple(f"{round(float(v), n) + 0.0:.{n}f}" for v, n in zip(values, places, strict=True))


# -- ABB --------------------------------------------------------------------------------------------------


def _abb_numbers(pose: Array) -> tuple[str, ...]:
    return _fixed([*pose[:3, 3], *notation.quaternion(pose, (1.0, 0.0, 0.0, 0.0))], (5, 5, 5, 9, 9, 9, 9))


def _abb_file(export: ExportRequest, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> str:
    def pose(frame: NamedFrame) -> str:
        return f"[[{','.join(frame.numbers[:3])}],[{','.join(frame.numbers[3:])}]]"

    lines = ["MODULE TruePoseFrames", *comment(export.about, "  ! ")]
    for tool in tools:
        lines += comment([f"{tool.key}: {tool.name}"], "  ! ")
        lines.append(f"  PERS tooldata {tool.key}:=[TRUE,{pose(tool)},[-1,[0,0,0],[1,0,0,0],0,0,0]];")
    for work in works:
        lines += comment([f"{work.key}: {_USE[work.name]}"], "  ! ")
        lines.append(f'  PERS wobjdata {work.key}:=[FALSE,TRUE,"",{pose(work)},[[0,0,0],[1,0,0,0]]];')
    return "\n".join([*lines, "ENDMODULE", ""])


_USE = {
    "base": "for targets in the controller's own world",
    "world": "for targets in the frame of the readings",
}
_ABB = FrameDialect(
    "abb",
    "ABB",
    ("x", "y", "z", "q1", "q2", "q3", "q4"),
    _abb_numbers,
    lambda v: notation.of_quaternion(v[:3], v[3:]),
    _named("tTP_", "wTP_", 32),
    _abb_file,
    r"tooldata tTP_flange:=\[TRUE,(\[\[.*?\]\]),",
    r'wobjdata wTP_base:=\[FALSE,TRUE,"",(\[\[.*?\]\]),',
    ("The base frame of the mechanical unit must be that of the world, as delivered.",),
    (
        "The load of a tool is not defined here (mass -1): identify it, or copy that of your own tool, before you "
        "move with it.",
    ),
)

# -- Fanuc ------------------------------------------------------------------------------------------------

_REGISTER = 100  # position register through which the program carries the numbers


def _wpr_numbers(pose: Array, places: int, turned: int) -> tuple[str, ...]:
    angles = notation.wpr(pose, (0.0, 0.0, 0.0))
    return _fixed([*pose[:3, 3], *angles], (*[places] * 3, *[turned] * 3))


def _of_wpr(values: Sequence[float]) -> Array:
    return notation.of_wpr(values[:3], values[3:])


def _fanuc_file(export: ExportRequest, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> str:
    about = [line.replace(";", ",") for line in export.about]
    body = comment([*about, f"PR[{_REGISTER}] is overwritten, and the frames below"], "!", 31)
    body += ["MESSAGE[Sets UTOOL and UFRAME]", "PAUSE"]
    order = [("UTOOL", tools[0]), ("UFRAME", works[0])]  # those that are read back come first
    order += [*(("UTOOL", tool) for tool in tools[1:]), *(("UFRAME", work) for work in works[1:])]
    for k, (kind, frame) in enumerate(order, start=1):
        body += comment([f"{kind}[{frame.key}] {frame.name}".replace(";", ",")], "!", 31)
        body += [f"PR[{_REGISTER}]=P[{k}]    ", f"{kind}[{frame.key}]=PR[{_REGISTER}]"]
    lines = [
        *("/PROG  TPFRAMES", "/ATTR", "OWNER\t\t= MNEDITOR;", 'COMMENT\t\t= "TruePose frames";'),
        *("PROG_SIZE\t= 0;", "CREATE\t\t= DATE 26-01-01  TIME 00:00:00;"),
        *("MODIFIED\t= DATE 26-01-01  TIME 00:00:00;", "FILE_NAME\t= ;", "VERSION\t\t= 0;"),
        *(f"LINE_COUNT\t= {len(body)};", "MEMORY_SIZE\t= 0;", "PROTECT\t\t= READ_WRITE;"),
        *("TCD:  STACK_SIZE\t= 0,", "      TASK_PRIORITY\t= 50,", "      TIME_SLICE\t= 0,"),
        *("      BUSY_LAMP_OFF\t= 0,", "      ABORT_REQUEST\t= 0,", "      PAUSE_REQUEST\t= 0;"),
        *("DEFAULT_GROUP\t= 1,*,*,*,*;", "CONTROL_CODE\t= 00000000 00000000;", "/MN"),
        *(f"{k:4d}:  {line} ;" for k, line in enumerate(body, start=1)),
        "/POS",
    ]
    for k, (_, frame) in enumerate(order, start=1):
        x, y, z, w, p, r = frame.numbers
        lines += [
            f"P[{k}]{{",
            "   GP1:",
            "\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',",
            f"\tX = {x:>9}  mm,\tY = {y:>9}  mm,\tZ = {z:>9}  mm,",
            f"\tW = {w:>9} deg,\tP = {p:>9} deg,\tR = {r:>9} deg",
            "};",
        ]
    return "\n".join([*lines, "/END", ""])


_FANUC = FrameDialect(
    "fanuc",
    "Fanuc",
    ("X", "Y", "Z", "W", "P", "R"),
    lambda pose: _wpr_numbers(pose, 3, 3),
    _of_wpr,
    _numbered(9, 9),
    _fanuc_file,
    r"^P\[1\]\{.*?(\tX = .*?)\};",
    r"^P\[2\]\{.*?(\tX = .*?)\};",
    (),
    (
        f"TPFRAMES sets the frames when it is run, after a PAUSE, through PR[{_REGISTER}]: change the numbers of the "
        "frames and of this register if yours are in use. No move is in it.",
    ),
)

# -- KUKA -------------------------------------------------------------------------------------------------


def _kuka_numbers(pose: Array) -> tuple[str, ...]:
    x, y, z, c, b, a = _wpr_numbers(pose, 5, 6)
    return x, y, z, a, b, c


def _kuka_file(export: ExportRequest, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> str:
    lines = comment(export.about, "; ")
    lines += ["; Put these lines in the place of those with the same numbers in R1/System/$config.dat."]
    for kind, frames in (("TOOL", tools), ("BASE", works)):
        names = identifiers([frame.name for frame in frames], "TP_", 24)
        for frame in frames:
            cells = ",".join(f"{name} {value}" for name, value in zip("XYZABC", frame.numbers, strict=True))
            lines.append(f"{kind}_DATA[{frame.key}]={{{cells}}}")
            lines.append(f'{kind}_NAME[{frame.key},]="{names[frame.name]}"')
    return "\n".join([*lines, ""])


_KUKA = FrameDialect(
    "kuka",
    "KUKA",
    ("X", "Y", "Z", "A", "B", "C"),
    _kuka_numbers,
    lambda v: _of_wpr([*v[:3], v[5], v[4], v[3]]),
    _numbered(16, 32),
    _kuka_file,
    r"^TOOL_DATA\[16\]=\{(.*?)\}",
    r"^BASE_DATA\[32\]=\{(.*?)\}",
    (
        "$ROBROOT must be that of the world, as delivered. For the KR C: a robot with Sunrise has no $config.dat.",
    ),
    ("Load data are not written: enter LOAD_DATA of the same number.",),
)

# -- UR ---------------------------------------------------------------------------------------------------


def _ur_numbers(pose: Array) -> tuple[str, ...]:
    return _fixed([*(pose[:3, 3] / _METRE), *notation.rotation_vector(pose, (0.0, 0.0, 0.0))], (8,) * 6)


def of_ur(values: Sequence[float]) -> Array:
    """Return the pose (4, 4), mm, of a UR's p[x, y, z, rx, ry, rz] in m and rad."""
    return notation.of_vector([_METRE * v for v in values[:3]], values[3:])


def _ur_file(export: ExportRequest, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> str:
    lines = comment(export.about, "# ")
    lines += [
        "# Copy the lines below into your program, and use them so:",
        f"#   set_tcp({tools[-1].key})          # Installation > TCP takes the same numbers, in mm and rad",
        "#   movel(pose_trans(tp_base, target))  # a target in the robot's base;",
    ]
    if len(works) > 1:
        lines.append("#   movel(pose_trans(tp_world, target)) # a target in the frame of the readings")
    for frame in (*tools, *works):
        lines += comment(
            [f"{frame.key}: {_USE.get(frame.name, frame.name) if frame in works else frame.name}"], "# "
        )
        lines.append(f"{frame.key} = p[{', '.join(frame.numbers)}]")
    return "\n".join([*lines, ""])


UR_FACTORY = (
    "A UR calculates with its own factory calibration, not with nominal DH numbers. Without a robot file that holds "
    "the controller's numbers (truepose doctor compares them), these frames correct again what it corrects already."
)
UR = FrameDialect(
    "universal robots",
    "UR",
    ("x", "y", "z", "rx", "ry", "rz"),
    _ur_numbers,
    of_ur,
    _named("tp_tool_", "tp_", 32),
    _ur_file,
    r"^tp_tool_flange = p\[(.*?)\]",
    r"^tp_base = p\[(.*?)\]",
    (UR_FACTORY,),
)

# -- Yaskawa ----------------------------------------------------------------------------------------------


def _yaskawa_file(export: ExportRequest, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> str:
    lines = comment(export.about, "' ")
    lines += comment(
        [
            "Rows of TOOL.CND and UFRAME.CND, not a file to load. Save both from the controller. In TOOL.CND, put "
            "name and first row of numbers into the tool of the same number; keep its rows of weight and inertia. "
            "In UFRAME.CND, put the row ////BUSER into the user frame of the same number. Load both, or type the "
            "numbers on the screens ROBOT > TOOL and ROBOT > USER COORDINATE."
        ],
        "' ",
    )
    for kind, frames in (("TOOL", tools), ("UFRAME", works)):
        names = identifiers([frame.name for frame in frames], "TP_", 16)
        for frame in frames:
            row = ",".join(frame.numbers)
            row = f"////BUSER {row}" if kind == "UFRAME" else row
            lines += [f"//{kind} {frame.key}", f"///NAME {names[frame.name]}", row]
    return "\n".join([*lines, ""])


_YASKAWA = FrameDialect(
    "yaskawa",
    "Yaskawa",
    ("X", "Y", "Z", "Rx", "Ry", "Rz"),
    lambda pose: _wpr_numbers(pose, 3, 4),
    _of_wpr,
    _numbered(63, 63),
    _yaskawa_file,
    r"^//TOOL 63\n[^\n]*\n([^\n]*)\n",
    r"^//UFRAME 63\n[^\n]*\n////BUSER ([^\n]*)\n",
)

DIALECTS = (_ABB, _FANUC, _KUKA, UR, _YASKAWA)
FRAME_FORMATS: Mapping[str, Format] = {f"{each.called.lower()}-frames": _format(each) for each in DIALECTS}
