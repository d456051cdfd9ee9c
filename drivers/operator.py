"""The operator as a device: asked by prompts, answers confirm, skip, redo, pause or abort.

A person is never assumed: without a terminal, with its input closed or its page gone, asking raises NoOperator instead
of continuing as if a person had confirmed.
"""

from __future__ import annotations

import sys
import threading
from typing import TextIO

from drivers.errors import Busy, NoOperator, Refused
from drivers.interfaces import Answer, Prompt, Typed

_SHOWN = 60  # characters of the typed text
_NO_TEXT = "\ufffd"
_LETTERS = {answer.value[0]: answer for answer in Answer}


class UnknownPrompt(Refused):
    """An answer to a prompt that is not, or no longer, being asked, or that it does not expect."""

    code = 3020
    advice = "Look at the prompt shown now and answer that one."


def refused(prompt: Prompt, answer: Answer | Typed) -> str:
    """Return the reason why a prompt does not accept this answer; empty if it does."""
    entry = prompt.entry
    if isinstance(answer, Typed):
        return "" if entry is not None else f"prompt {prompt.id} asks for no numbers"
    if answer not in prompt.expects:
        return f"prompt {prompt.id} does not expect {answer.value}"
    if answer is Answer.CONFIRM and entry is not None and entry.needed:
        return f"prompt {prompt.id} asks for {', '.join(entry.names)} in {entry.unit}: type them"
    return ""


class TerminalOperator:
    """An operator at a terminal.

    Answers are the word or its first letter; an empty line confirms nothing. If numbers are requested, any other line
    counts as the numbers.
    """

    def __init__(self, reader: TextIO | None = None, writer: TextIO | None = None) -> None:
        self._reader = sys.stdin if reader is None else reader
        self._writer = sys.stderr if writer is None else writer

    def ask(self, prompt: Prompt) -> Answer | Typed:
        """Ask until one of the expected answers is given.

        Raises
        ------
        NoOperator
            There is no terminal, or it was closed.
        """
        if self._reader is None or self._reader.closed or not self._reader.isatty():
            raise NoOperator("no terminal to ask on", device="operator", command=prompt.id)
        needed = prompt.entry is not None and prompt.entry.needed
        expects = [answer for answer in prompt.expects if not (needed and answer is Answer.CONFIRM)]
        keys = ", ".join(f"{answer.value[0]} to {answer.value}" for answer in expects)
        keys = (
            keys
            if prompt.entry is None
            else f"{' '.join(prompt.entry.names)} [{prompt.entry.unit}], or {keys}"
        )
        before = ""
        while True:
            line = self._line(f"{before}{prompt.text}\n  Type {keys}, then Enter: ", prompt)
            word = line.strip().lower()
            answer = _LETTERS.get(word[:1]) if word else None
            if answer in expects and answer is not None and word in (answer.value, answer.value[0]):
                return answer
            if prompt.entry is not None and any(map(str.isdigit, word)):
                return Typed(line.strip())
            before = "  Enter alone answers nothing. "
            if word:
                before = f"  {word[:_SHOWN]!r}{'...' * (len(word) > _SHOWN)} is not one of these. "

    def _line(self, question: str, prompt: Prompt) -> str:
        """Return the typed line, or a mark if it is not text.

        Raises
        ------
        NoOperator
            The input ended, or the terminal is gone.
        """
        try:
            self._writer.write(question)
            self._writer.flush()
            line = self._reader.readline()
        except UnicodeDecodeError:
            return _NO_TEXT
        except (OSError, ValueError) as error:  # its window was closed, its connection was cut
            raise NoOperator("the terminal is gone", device="operator", command=prompt.id) from error
        if not line:
            raise NoOperator("input of the terminal ended", device="operator", command=prompt.id)
        return line


class RemoteOperator:
    """An operator who is asked by publishing the prompt.

    Another thread (HTTP) brings the answer with the id of the prompt.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._pending: Prompt | None = None
        self._answer: Answer | Typed | None = None
        self._closed = False

    @property
    def pending(self) -> Prompt | None:
        """The prompt that is being asked, or None."""
        with self._changed:
            return self._pending

    def ask(self, prompt: Prompt) -> Answer | Typed:
        """Publish the prompt and wait for its answer without a limit.

        Raises
        ------
        NoOperator
            The operator was closed.
        Busy
            Another prompt is being asked.
        """
        with self._changed:
            if self._pending is not None:
                raise Busy(f"already asking {self._pending.id}", device="operator", command=prompt.id)
            self._pending, self._answer = prompt, None
            self._changed.notify_all()
            try:
                self._changed.wait_for(lambda: self._answer is not None or self._closed)
                if self._answer is None:
                    raise NoOperator("the operator page was closed", device="operator", command=prompt.id)
                return self._answer
            finally:
                self._pending = None
                self._changed.notify_all()

    def answer(self, prompt_id: str, answer: Answer | Typed) -> None:
        """Answer the pending prompt.

        Raises
        ------
        UnknownPrompt
            The prompt has another id, or does not accept the answer.
        """
        with self._changed:
            pending = self._pending
            if pending is None or pending.id != prompt_id or self._answer is not None:
                raise UnknownPrompt(
                    f"prompt {prompt_id} is not being asked", device="operator", command=prompt_id
                )
            if refusal := refused(pending, answer):
                raise UnknownPrompt(refusal, device="operator", command=prompt_id)
            self._answer = answer
            self._changed.notify_all()

    def close(self) -> None:
        """Close: no answer will come any more, and a waiting `ask` raises NoOperator."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class RehearsalOperator:
    """An operator that confirms every prompt at once, for simulated cells only."""

    def ask(self, prompt: Prompt) -> Answer:
        return Answer.CONFIRM
