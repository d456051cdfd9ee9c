"""The error of the numerical part: one error class for input that a person must correct.

A `DataError` states the cause and the remedy, and the file, line or key if they are known.
The command line turns it into exit code 2, the HTTP service into a problem document.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path


class DataError(ValueError):
    """Input that cannot be used as it is. `str(error)` is the whole sentence for the operator.

    Parameters
    ----------
    what : str
        Cause, without the place.
    do : str
        Remedy.
    file, line, key : optional
        Place of the mistake; None if a part of it is not known.

    Examples
    --------
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
        """Keep the keyword arguments when the error is pickled, which `pickle` alone would lose."""
        again = partial(type(self), do=self.do, file=self.file, line=self.line, key=self.key)
        return again, (self.what,)
