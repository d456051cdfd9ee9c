"""The operator as a device: no confirmation without an operator."""

from __future__ import annotations

import io

import pytest

from drivers import (
    Answer,
    Busy,
    NoOperator,
    Operator,
    Prompt,
    RehearsalOperator,
    RemoteOperator,
    TerminalOperator,
    UnknownPrompt,
)
from tests.drivers.waiting import PATIENCE_S, in_thread, until

SEAT = Prompt("p1", "Seat the SMR in T1 and press confirm", (Answer.CONFIRM, Answer.SKIP, Answer.ABORT))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_all_are_operators() -> None:
    assert all(isinstance(o, Operator) for o in (TerminalOperator(), RemoteOperator(), RehearsalOperator()))
    assert RehearsalOperator().ask(SEAT) is Answer.CONFIRM


@pytest.mark.parametrize(
    ("typed", "answer"),
    [("confirm\n", Answer.CONFIRM), ("S\n", Answer.SKIP), ("\nyes\nredo\nabort\n", Answer.ABORT)],
)
def test_terminal_asks_until_it_understands(typed: str, answer: Answer) -> None:
    shown = io.StringIO()
    assert TerminalOperator(Terminal(typed), shown).ask(SEAT) is answer
    assert f"{SEAT.text}\n  Type c to confirm, s to skip, a to abort, then Enter: " in shown.getvalue()


def test_terminal_says_why_it_asks_again() -> None:
    shown = io.StringIO()
    TerminalOperator(Terminal("\nyes\nredo\nc\n"), shown).ask(SEAT)
    assert shown.getvalue().count(SEAT.text) == 4
    for said in ("Enter alone answers nothing", "'yes' is not one of these", "'redo' is not one of these"):
        assert said in shown.getvalue()


def test_terminal_refuses_without_a_terminal() -> None:
    closed = Terminal("confirm\n")
    closed.close()
    for reader in (io.StringIO("confirm\n"), closed, Terminal("")):
        with pytest.raises(NoOperator) as caught:
            TerminalOperator(reader, io.StringIO()).ask(SEAT)
        assert caught.value.exit_code == 4


def lost() -> str:
    raise OSError(5, "Input/output error")


def test_a_terminal_that_is_lost_is_nobody() -> None:
    """Its window is closed, or its connection cut, during the question.

    The program must not wait for ever.
    """
    for name in ("readline", "write"):
        reader, writer = Terminal("c\n"), io.StringIO()
        setattr(reader if name == "readline" else writer, name, lambda *_: lost())
        with pytest.raises(NoOperator, match="gone"):
            TerminalOperator(reader, writer).ask(SEAT)


def test_what_is_no_text_or_too_much_of_it_is_asked_for_again() -> None:
    class Pasted(io.TextIOWrapper):
        def isatty(self) -> bool:
            return True

    pasted = b"\xff\xfe\x80 1\n" + b"x" * 1_000_000 + b"\nc\n"
    shown = io.StringIO()
    reader = Pasted(io.BufferedReader(io.BytesIO(pasted), 16), encoding="utf-8")
    reader._CHUNK_SIZE = 8  # type: ignore[attr-defined]  # as a terminal gives it: line by line
    assert TerminalOperator(reader, shown).ask(SEAT) is Answer.CONFIRM
    assert "'\N{REPLACEMENT CHARACTER}' is not one of these" in shown.getvalue()
    assert f"'{'x' * 60}'... is not one of these" in shown.getvalue()
    assert len(shown.getvalue()) < 2000
    TerminalOperator(Terminal("\0\nc\n"), shown := io.StringIO()).ask(SEAT)
    assert "'\\x00' is not one of these" in shown.getvalue()


def test_remote_answer_reaches_the_one_who_asks() -> None:
    operator = RemoteOperator()
    asked = in_thread(lambda: operator.ask(SEAT))
    until(lambda: operator.pending)
    assert operator.pending == SEAT
    with pytest.raises(UnknownPrompt):
        operator.answer("p0", Answer.CONFIRM)
    with pytest.raises(UnknownPrompt, match="redo"):
        operator.answer("p1", Answer.REDO)
    with pytest.raises(Busy):
        operator.ask(SEAT)
    operator.answer("p1", Answer.SKIP)
    assert asked.result(PATIENCE_S) is Answer.SKIP
    assert operator.pending is None
    with pytest.raises(UnknownPrompt):
        operator.answer("p1", Answer.CONFIRM)


def test_remote_closed_is_not_a_confirmation() -> None:
    operator = RemoteOperator()
    asked = in_thread(lambda: operator.ask(SEAT))
    until(lambda: operator.pending)
    operator.close()
    with pytest.raises(NoOperator):
        asked.result(PATIENCE_S)
