"""`python -m tests.steady [--times 50] [--busy 4] [--log FILE] TEST ...`: tests again and again beside busy processes.

A TEST is anything that pytest takes: a file, a folder, an address with `::`. Without one, all files are run whose tests
use a thread, a socket, a process or a simulated device: hours. With a log they can be spread over as many sessions as
one likes: each TEST adds a line of JSON when it is through, one that has its line is not run again, and Ctrl-C loses
the one in hand. Prints which failed how often, those in the log with them; exit code 1 when one did.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree

import grimp

ROOT = Path(__file__).parents[2]
TIMES, BUSY, JOBS = 50, 4, 2
_WAITS = re.compile(
    r"\b(CellThread|simulated_cell|in_thread|Thread|ThreadPoolExecutor|socket|subprocess|Popen|served|in_held_service|RIGS"
    r"|distributed)\b"
)
_TESTS = re.compile(r"^ *def test_", re.MULTILINE)
_TIME = re.compile(r"-?time \d+(?=\])|time \d+-")


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Run `count` processes that compute without end, until the block ends."""
    command = [sys.executable, "-c", "while True: pass"]
    burners = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for each in burners:
            each.kill()
            each.wait()


def waiting_files() -> list[str]:
    """List all test files that wait for other threads or programs.

    They use a thread, a socket, a process or a simulated device, or import a module that does.
    """
    graph = grimp.build_graph("tests", cache_dir=None)
    files = {name: ROOT / (name.replace(".", "/") + ".py") for name in graph.modules}
    texts = {name: file.read_text("utf-8") for name, file in sorted(files.items()) if file.is_file()}
    waiting = {name for name, text in texts.items() if _WAITS.search(text)}
    return [
        str(files[name].relative_to(ROOT))
        for name, text in texts.items()
        if files[name].name.startswith("test_")
        and _TESTS.search(text)  # some lend others what they wait with
        and waiting & {name, *graph.find_upstream_modules(name)}
    ]


@dataclass(frozen=True)
class Done:
    """Result of one TEST: how often each of its tests failed, of how many runs in all."""

    test: str
    times: int
    busy: int
    runs: int
    failed: dict[str, int]


def of_report(report: Path) -> tuple[Counter[str], int]:
    """Count the failures of each test, and all runs, of a JUnit report."""
    failed: Counter[str] = Counter()
    cases = list(ElementTree.parse(report).iter("testcase"))
    for case in cases:
        if case.find("failure") is not None or case.find("error") is not None:
            name = _TIME.sub("", case.get("name", "")).replace("[]", "")
            failed[f"{case.get('classname')}.{name}"] += 1
    return failed, len(cases)


def run(test: str, times: int, busy: int, jobs: int) -> Done:
    """Run one TEST `times` times.

    Raises
    ------
    RuntimeError
        Pytest could not run.
    """
    with tempfile.TemporaryDirectory(prefix="truepose-steady-") as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.steady.repeat", "--repeat", str(times)]
        command += ["-n", str(jobs), f"--junitxml={report}", test]
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        if code not in (0, 1):
            raise RuntimeError(f"pytest ended with {code}: see above")
        failed, runs = of_report(report)
        return Done(test, times, busy, runs, dict(failed))


def logged(log: Path) -> list[Done]:
    """Read the results of earlier sessions."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    return [Done(**json.loads(line)) for line in lines]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print; 0 when nothing failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.steady", description=__doc__)
    parser.add_argument("--times", type=int, default=TIMES, help="how often each test runs (%(default)s)")
    parser.add_argument("--busy", type=int, default=BUSY, help="busy processes in addition (%(default)s)")
    parser.add_argument("--jobs", type=int, default=JOBS, help="test processes (%(default)s)")
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="tests that have passed, kept for further sessions"
    )
    parser.add_argument("test", nargs="*", metavar="TEST")
    options = parser.parse_args(arguments)
    log: Path | None = options.log
    done = [] if log is None else logged(log)
    through = {each.test for each in done if (each.times, each.busy) == (options.times, options.busy)}
    with busy_processes(options.busy):
        for test in options.test or waiting_files():
            if test in through:
                continue
            done.append(run(test, options.times, options.busy, options.jobs))
            if log is not None:
                with log.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(done[-1])) + "\n")
    for each in done:
        for name, count in each.failed.items():
            sys.stdout.write(f"{count:4d} of {each.times}  {name}\n")
    failed = sum(sum(each.failed.values()) for each in done)
    runs = sum(each.runs for each in done)
    sys.stdout.write(f"{len(done)} TESTs, {runs} runs beside busy processes, {failed} failed\n")
    return 1 if failed or not runs else 0


if __name__ == "__main__":
    sys.exit(main())
