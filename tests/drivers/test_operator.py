"""The operator as a device: never a confirmation that nobody gave."""

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
