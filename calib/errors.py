"""The error of the numerical part: one error class for input that a person must correct.

A `DataError` names the file, and where it can the line or the key, says what is wrong and what to do.
The command line turns it into exit code 2, the HTTP service into a problem document.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path


class DataError(ValueError):
    """Input that cannot be used as it is. `str(error)` is the whole sentence for the operator.

    what: is wrong; do: what to do about it; file, line, key: where, each None where it says nothing.

    >>> error = DataError("is 4.", do="Use 1, 2 or 3.", key="level")
    >>> print(error)
    key 'level': is 4. Use 1, 2 or 3.
    >>> error.do
    'Use 1, 2 or 3.'
    """

    def __init__(
        self,
        what: str,
        *,
        do: str,
        file: Path | str | None = None,
        line: int | None = None,
        key: str | None = None,
    ) -> None:
        place = "" if file is None else str(file)
        if line is not None:
            place += f", line {line}"
        if key is not None:
            place += f", key '{key}'" if place else f"key '{key}'"
        super().__init__(f"{place}: {what} {do}" if place else f"{what} {do}")
        self.what, self.do, self.file, self.line, self.key = what, do, file, line, key

    def __reduce__(self) -> tuple[object, ...]:
        """The error comes through a pipe whole: pickle by itself forgets what was given by name."""
        again = partial(type(self), do=self.do, file=self.file, line=self.line, key=self.key)
        return again, (self.what,)
