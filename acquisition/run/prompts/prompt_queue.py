"""The prompts to the operator: rows of the record, answered on a terminal or by HTTP.

The first answer counts. The operator device is asked in a separate thread, because a person may take an hour and a stop
may not wait. When the campaign stops waiting, the prompt is void and the thread is abandoned.
"""

from __future__ import annotations

import threading
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from acquisition.record.attempts import VOID, Attempts
from acquisition.run.orders.control import Control
from acquisition.run.prompts.picture import WORDS_ALONE, PromptPicture
from drivers.errors import AcquisitionError
from drivers.interfaces import Answer, Operator, Prompt, Typed, TypedEntry
from drivers.operator import RehearsalOperator, RemoteOperator, TerminalOperator, UnknownPrompt, refused

_WHO = {TerminalOperator: "at the terminal", RehearsalOperator: "scripted, a rehearsal"}
"""Who answered, for record and report, where nobody gave a name."""

CHOICES = (Answer.CONFIRM, Answer.SKIP, Answer.ABORT)


@dataclass(frozen=True)
class PromptAnswer:
    """An answer with its author, its reason, and the typed values."""

    answer: Answer
    by: str
    reason: str = ""
    typed: str = ""


class PromptQueue:
    """The prompts to a person, one at a time.

    Parameters
    ----------
    picture
        File for drawings, shown to a person at a terminal.
    person
        Answers prompts with an entry. Default: the operator.
    """

    def __init__(
        self,
        attempts: Attempts,
        operator: Operator | None,
        control: Control,
        picture: Path | None = None,
        person: Operator | None = None,
    ) -> None:
        self._attempts = attempts
        self._operator = operator
        self._control = control
        self._picture = picture
        self._person = person or operator
        self._changed = threading.Condition()
        self._pending: Prompt | None = None
        self._answer: PromptAnswer | None = None
        self._failure: AcquisitionError | None = None
        self._asker: threading.Thread | None = None
        control.watch(self._wake)

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def ask(
        self,
        text: str,
        picture: PromptPicture = WORDS_ALONE,
        *,
        redo: bool = False,
        pause: bool = False,
        entry: TypedEntry | None = None,
    ) -> PromptAnswer:
        """Ask a person and wait for the answer; ABORT is returned like any answer.

        Parameters
        ----------
        redo
            Whether the person may request the last reading again.
        pause
            Whether the person may pause the run.
        entry
            Numbers that the person types.

        Raises
        ------
        NoOperator
            There is no person to answer.
        Pausing, Stopping
            The run must pause or stop.
        """
        choices = (*CHOICES, *[Answer.REDO] * redo, *[Answer.PAUSE] * pause)
        prompt = Prompt(uuid.uuid4().hex[:12], text, choices, picture.name, entry)
        with self._changed:
            self._pending, self._answer, self._failure = prompt, None, None
        if picture.drawing is not None and self._picture is not None:
            with suppress(OSError):  # a full disk is reported when it costs a reading
                self._picture.write_text(picture.drawing, encoding="utf-8")
        self._attempts.ask(prompt)
        operator = self._operator if entry is None else self._person
        if operator is not None:
            self._asker = threading.Thread(target=self._put, args=(operator, prompt), daemon=True)
            self._asker.start()
        with self._changed:
            self._changed.wait_for(lambda: self._answer or self._failure or self._control.asked)
            answer, failure, self._pending = self._answer, self._failure, None
        self._withdraw(prompt)
        if answer is None:
            self._attempts.answered(prompt.id, VOID, "program")
            if failure is not None:
                raise failure
            self._control.check()
            raise AssertionError("woken without a reason")
        self._attempts.answered(prompt.id, answer.answer.value, answer.by, answer.reason, answer.typed)
        return answer

    def answer(self, prompt_id: str, answer: Answer, by: str, reason: str = "", typed: str = "") -> None:
        """Answer the current prompt, from any thread.

        Raises
        ------
        UnknownPrompt
            The prompt is not being asked, or the answer does not fit it.
        """
        with self._changed:
            pending = self._pending
            if pending is None or pending.id != prompt_id or self._answer is not None:
                raise UnknownPrompt(f"prompt {prompt_id} is not being asked", device="operator")
            with_typed = Typed(typed) if typed.strip() and answer is Answer.CONFIRM else answer
            if refusal := refused(pending, with_typed):
                raise UnknownPrompt(refusal, device="operator")
            self._answer = PromptAnswer(answer, by, reason, typed)
            self._changed.notify_all()

    def _put(self, operator: Operator, prompt: Prompt) -> None:
        try:
            answer = operator.ask(prompt)
        except AcquisitionError as error:
            with self._changed:
                if self._pending is prompt:
                    self._failure = error
                    self._changed.notify_all()
            return
        with self._changed:
            if self._pending is prompt and self._answer is None:
                by = _WHO.get(type(operator), type(operator).__name__)
                typed = answer.text if isinstance(answer, Typed) else ""
                self._answer = PromptAnswer(
                    Answer.CONFIRM if isinstance(answer, Typed) else answer, by, typed=typed
                )
                self._changed.notify_all()

    def _withdraw(self, prompt: Prompt) -> None:
        """Inform a page that still shows the prompt that it is over.

        A terminal keeps waiting for its line.
        """
        operator, asker = self._operator, self._asker
        if not isinstance(operator, RemoteOperator) or asker is None:
            return
        while asker.is_alive():  # it may not even have begun to ask; the next prompt must find it gone
            shown = operator.pending
            if shown is not None and shown.id == prompt.id:
                with suppress(UnknownPrompt):  # a person answered in this moment
                    operator.answer(prompt.id, Answer.ABORT)
            asker.join(0.01)
