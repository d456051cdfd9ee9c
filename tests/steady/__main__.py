"""`python -m tests.steady [--times 50] [--busy 4] TEST ...`: chosen tests again and again beside busy processes.

A TEST is anything that pytest takes: a file, a folder, an address with `::`. Without one, all files are run whose tests
use a thread, a socket, a process or a simulated device. Prints which failed how often; exit code 1 when one did.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
TIMES, BUSY, JOBS = 50, 4, 2
_WAITS = re.compile(r"CellThread|simulated_cell|in_thread|threading|socket|subprocess|Popen|ServiceThread")
_TIME = re.compile(r"-?time \d+(?=\])|time \d+-")


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that compute without end, until the block ends."""
    command = [sys.executable, "-c", "while True: pass"]
    burners = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for each in burners:
            each.kill()
            each.wait()


def waiting_files() -> list[str]:
    """Every file of tests that uses a thread, a socket, a process or a simulated device."""
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    return [str(each.relative_to(ROOT)) for each in files if _WAITS.search(each.read_text(encoding="utf-8"))]


def failures(report: Path) -> tuple[Counter[str], int]:
    """How often each test failed, and how many runs there were, of a JUnit report."""
    failed: Counter[str] = Counter()
    cases = list(ElementTree.parse(report).iter("testcase"))
    for case in cases:
        if case.find("failure") is not None or case.find("error") is not None:
            name = _TIME.sub("", case.get("name", "")).replace("[]", "")
            failed[f"{case.get('classname')}.{name}"] += 1
    return failed, len(cases)


def run(tests: Sequence[str], times: int, jobs: int) -> tuple[Counter[str], int]:
    """Failures of each test, and the number of runs. Raises RuntimeError when pytest could not run them."""
    with tempfile.TemporaryDirectory(prefix="truepose-steady-") as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.steady.repeat", "--repeat", str(times)]
        command += ["-n", str(jobs), f"--junitxml={report}", *tests]
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        if code not in (0, 1):
            raise RuntimeError(f"pytest ended with {code}: see above")
        return failures(report)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print; 0 when nothing failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.steady", description=__doc__)
    parser.add_argument("--times", type=int, default=TIMES, help="how often each test runs (%(default)s)")
    parser.add_argument("--busy", type=int, default=BUSY, help="busy processes beside them (%(default)s)")
    parser.add_argument("--jobs", type=int, default=JOBS, help="test processes (%(default)s)")
    parser.add_argument("test", nargs="*", metavar="TEST")
    options = parser.parse_args(arguments)
    with busy(options.busy):
        failed, runs = run(options.test or waiting_files(), options.times, options.jobs)
    for name, count in failed.most_common():
        sys.stdout.write(f"{count:4d} of {options.times}  {name}\n")
    sys.stdout.write(f"{runs} runs beside {options.busy} busy processes, {failed.total()} failed\n")
    return 1 if failed or not runs else 0


if __name__ == "__main__":
    sys.exit(main())
