"""Entry point of the command `truepose`.

It runs the Typer app of `service.commands` and turns errors into exit codes, which are a stable interface: see
`service.exit_codes`.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from service import exit_codes

if TYPE_CHECKING:
    from service.refusals import Refusal


OVERWRITE = "--overwrite"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (default: that of the process) and return its exit code.

    Input that cannot be used ends with one message on standard error and no traceback.
    """
    try:
        return _run(arguments)
    except KeyboardInterrupt:  # while modules are loaded; inside a command Typer turns it into the same code
        return exit_codes.INTERRUPTED


def _run(arguments: Sequence[str] | None) -> int:
    # Threads of the linear algebra library spin while they wait for each other: on a shared two-core PC they make
    # fits of this size five to ten times slower. To use them, set the variables. They are read when numpy is first
    # imported, hence the late imports below.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        # A Windows console that cannot show a letter shows '?', instead of ending the program.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    from service.commands import app

    try:
        app(args=_in_front(sys.argv[1:] if arguments is None else arguments), prog_name="truepose")
    except SystemExit as end:  # how Typer hands over the code of every command, 130 after an interrupt
        return end.code if isinstance(end.code, int) else exit_codes.DONE
    except _refusals() as error:
        return _refused(error)
    except OSError as error:
        return _complain(f"{error.filename or 'a file'}: {error.strerror or error}.", exit_codes.FAILED)
    return exit_codes.DONE


def _in_front(arguments: Sequence[str]) -> list[str]:
    """Move `--overwrite`, an option of all commands, to the front, where Typer expects it."""
    own = list(arguments)
    end = own.index("--") if "--" in own else len(own)
    others = [each for each in own[:end] if each != OVERWRITE]
    return [*([OVERWRITE] if len(others) < end else []), *others, *own[end:]]


def _refusals() -> tuple[type[Refusal], ...]:
    """Import the refusals with which a command may end.

    They are imported only after a command has failed, so that `--help` does not wait for the numerical modules.
    """
    from service.refusals import REFUSALS

    return REFUSALS


def _refused(refusal: Refusal) -> int:
    from service import refusals

    return _complain(refusals.sentence(refusal), refusals.exit_code(refusal))


def _complain(message: str, code: int) -> int:
    # The name of a file may hold control characters, which a terminal would obey.
    message = "".join(
        each if each.isprintable() or each in "\n\N{NO-BREAK SPACE}" else "\ufffd" for each in message
    )
    sys.stderr.write(f"truepose: {message}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
