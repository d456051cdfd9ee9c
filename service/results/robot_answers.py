"""History of robots as answered: a list, one robot, its trends, and the data sent.

The service knows these as it starts, without the store.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from service.results.shape import Real, ResponseBody, told

_HASH = "a93c6fe109b1ae117f0e7f2bb0621db385ac9f84da4fc45fa30a1e73de499bda"


def text_of(moment: datetime) -> str:
    """A moment as JSON has it, UTC."""
    return f"{moment:%Y-%m-%dT%H:%M:%SZ}"


def _as_text(value: Any) -> Any:
    return text_of(value) if isinstance(value, datetime) else value


AsText = BeforeValidator(_as_text)
Moment = Annotated[
    str,
    AsText,
    told("When the first reading was taken, RFC 3339 UTC.", "2026-03-02T09:15:00Z", of="measured_at"),
]
RobotState = Literal[
    "not_watched", "recalibrated", "unchanged", "changed", "ambiguous", "unexplained", "retired"
]
DocumentKind = Literal["model", "watch", "campaign", "dataset", "diagnosis", "thermal", "retired"]
DocumentHash = Annotated[str, told("SHA-256 of the document, by which it is asked for.", _HASH, of="hash")]
RobotId = Annotated[str, told("The id of the robot in addresses.", "3f9a1c07b2e48d15")]
Serial = Annotated[str, told("Its serial number.", "120-500321")]
Type = Annotated[str, told("Its type, as robot files name it.", "abb-irb120")]
Advice = Annotated[str, told("What to do, a sentence.", "Re-zero joint 4 by 0.031 deg.")]
InWords = Annotated[str, told("What was found, in words.", "Joint 4 lost its zero.")]
_CAUSE = {"label": "joint_step:j4", "value": 0.031, "u": 0.004, "unit": "deg"}


class ErrorShown(ResponseBody):
    """The position error that was found last."""

    rms: Annotated[float, told("Root mean square, mm.", 0.081, of="value")]
    u: Annotated[Real, told("Its expanded uncertainty U (k = 2), mm.", 0.01)]


class ErrorOnDate(ErrorShown):
    """The position error that was found on a day."""

    measured: Moment


class CauseNamed(ResponseBody):
    """A cause that a watch names, or an effect that a diagnosis has found."""

    label: Annotated[str, told("What has changed, or acts.", "joint_step:j4")]
    in_words: InWords = ""
    value: Annotated[Real, told("Its size, in `unit`.", 0.031)]
    u: Annotated[Real, told("U of the size (k = 2), in `unit`.", 0.004)]
    unit: Annotated[str, told("The unit of value and u.", "deg")]
    weight: Annotated[Real, told("Probability among the members of its class.", 1.0)]


class SaidShown(ResponseBody):
    """The verdict and the texts of the last watch or diagnosis."""

    measured: Moment
    verdict: Annotated[str, told("Its verdict.", "changed")]
    in_words: InWords
    advice: Advice
    document: DocumentHash
    causes: Annotated[list[CauseNamed], told("The members of the class, likeliest first.", [_CAUSE])]


class BaselineNow(ResponseBody):
    """The newest calibration of a robot: not what a watch has updated."""

    document: DocumentHash
    measured: Moment


class DueShown(ResponseBody):
    """The date of the next check (ILAC-G24)."""

    date: Annotated[
        str | None, AsText, told("When, RFC 3339 UTC; null where none can be told.", "2026-09-01T08:00:00Z")
    ]
    overdue: Annotated[bool, told("Whether it has passed.", False)]
    because: Annotated[str, told("Why then, or why there is no date.", "It was never checked.")]


class RobotLine(ResponseBody):
    """A robot in the list."""

    id: RobotId
    serial: Serial
    model: Type
    cells: Annotated[list[str], told("Names of the cells that measured it.", ["irb120-cell"])]
    documents: Annotated[dict[str, int], told("Number of documents by kind.", {"model": 2, "watch": 12})]
    last_measured: Moment
    state: Annotated[
        RobotState,
        told(
            "The verdict of the last watch; recalibrated: a model is newer than it; retired: measured no more.",
            "unchanged",
        ),
    ]
    needs_care: Annotated[
        bool, told("Whether somebody has to act: it has changed, errs too much, or is overdue.", True)
    ]
    beyond_permitted: Annotated[bool, told("Whether the last position error is more than permitted.", False)]
    doubtful_date: Annotated[
        str | None,
        AsText,
        told("A date among its documents that only a wrong clock can have written, RFC 3339 UTC.", None),
    ]
    watched: Annotated[SaidShown | None, told("The last watch.", None)]
    diagnosed: Annotated[SaidShown | None, told("The last diagnosis.", None)]
    baseline: Annotated[
        BaselineNow | None, told("The newest calibration: the baseline of the next watch.", None)
    ]
    error_mm: Annotated[ErrorShown | None, told("The last position error, mm.", {"rms": 0.081, "u": 0.01})]
    errors: Annotated[list[ErrorOnDate], told("The last 24 position errors, oldest first, mm.", [])]
    due: Annotated[DueShown, told("When the next check is due.", {"date": None, "overdue": False})]


class NotKept(ResponseBody):
    """A result of this service that is not in the history."""

    path: Annotated[str, told("Where it lies in the record; empty: all of them.", "diagnoses/X/result.json")]
    because: Annotated[str, told("Why it is not.", "names no serial number of the robot.")]


class _OfStore(ResponseBody):
    store: Annotated[
        str,
        told("The address of the store, without its password.", "sqlite:////var/history.sqlite3"),
    ]
    now: Annotated[
        str,
        told("The time of the service, RFC 3339 UTC: dates are reckoned by it.", "2026-04-01T08:00:00Z"),
    ]
    permitted_mm: Annotated[
        Real,
        told("Position error, RMS, by which dates were reckoned, mm; null: nobody has said.", 0.2),
    ]
    left_out: Annotated[int, told("Number of further ones that are not in the answer.", 0)]


class Robots(_OfStore):
    """Every robot of the store."""

    robots: Annotated[
        list[RobotLine],
        told("What has changed first, the largest error first; what errs too much; what is overdue.", []),
    ]
    need_care: Annotated[int, told("Number of robots that need care, of all in the store.", 13)]
    not_kept: Annotated[list[NotKept], told("Results of this service that are not in the store.", [])]


class ResultHere(ResponseBody):
    """The result of this service that a document is."""

    kind: Annotated[Literal["run", "diagnosis", "watch", "upkeep", "loop"], told("What it is.", "diagnosis")]
    id: Annotated[str, told("Its id.", "20261121-170459-3f9a1c07b2e")]


class LineShown(ResponseBody):
    """A document of a robot with its statements."""

    measured: Moment
    kind: Annotated[DocumentKind, told("What it is.", "watch")]
    cell: Annotated[str, told("Name of the cell that made it.", "irb120-cell")]
    identity: Annotated[str, told("Which thing it is a statement of.", "watch a93c6fe1 model.json 0.01")]
    document: DocumentHash
    program: Annotated[str, told("The program that wrote it.", "truepose 0.1.0")]
    contradicts_another: Annotated[
        bool, told("Whether the store has another content for the same thing.", False)
    ]
    verdict: Annotated[str | None, told("The verdict, where it has one.", "changed")]
    advice: Annotated[str | None, told("What to do, where it says so.", "Nothing.")]
    in_words: InWords
    causes: Annotated[list[CauseNamed], told("Causes or effects that it names.", [_CAUSE])]
    error_mm: Annotated[ErrorShown | None, told("The position error that it found, mm.", None)]
    here: Annotated[
        ResultHere | None, told("The result of this service that it is; null: of elsewhere.", None)
    ]


class RobotResponse(RobotLine, _OfStore):
    """One robot: its line, and its documents."""

    history: Annotated[list[LineShown], told("Its documents, newest first.", [])]


class TrendValue(ResponseBody):
    """A value of a parameter."""

    measured: Moment
    value: Annotated[float, told("The value, in `unit` of the trend.", 0.031)]
    u: Annotated[Real, told("U (k = 2), in `unit` of the trend.", 0.004)]
    limits: Annotated[list[float] | None, told("The control limits for this value, in `unit`.", [0.01, 0.05])]
    signal: Annotated[bool, told("Whether it lies outside, itself or its mean with those before.", False)]
    document: DocumentHash
    program: Annotated[str, told("The program that wrote it.", "truepose 0.1.0")]
    rediagnosed: Annotated[bool, told("Whether a later version found it in the same readings.", False)] = (
        False
    )


class TrendResponse(ResponseBody):
    """The values of one parameter over time, and its control chart."""

    parameter: Annotated[str, told("Its name, as the model has it; error_rms: the position error.", "theta4")]
    unit: Annotated[str, told("The unit of its values.", "deg")]
    centre: Annotated[Real, told("Centre of the chart, in `unit`; null without one.", 0.03)]
    values: Annotated[list[TrendValue], told("Oldest first.", [])]
    signals: Annotated[list[str], told("What is outside its limits, a sentence each.", [])]
    no_chart_because: Annotated[str, told("Why there is no chart; empty where there is one.", "")]
    left_out: Annotated[int, told("Number of older values that are not in the answer.", 0)]


class Trends(ResponseBody):
    """The trends of a robot."""

    format: Annotated[Literal["truepose-history/1"], told("The format.", "truepose-history/1")]
    id: RobotId
    serial: Serial
    model: Type
    trends: Annotated[list[TrendResponse], told("One for every parameter, by name.", [])]


class AddedDocument(ResponseBody):
    """The outcome for one document."""

    kind: Annotated[DocumentKind, told("What it is.", "model")]
    serial: Serial
    model: Type
    identity: Annotated[str, told("Which thing it is a statement of.", "model a93c6fe1")]
    document: DocumentHash
    state: Annotated[
        Literal["new", "known", "conflict"],
        told(
            "known: the store had it; conflict: it has another content for the same thing, both are kept.",
            "new",
        ),
    ]
    contradicts: Annotated[list[str], told("Hashes of those other contents.", [])]


class AddResponse(ResponseBody):
    """The outcome for all that was sent."""

    format: Annotated[Literal["truepose-history/1"], told("The format.", "truepose-history/1")]
    robot_id: RobotId
    added: Annotated[list[AddedDocument], told("One for every document.", [])] = Field(default_factory=list)
