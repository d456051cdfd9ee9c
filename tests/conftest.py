"""Settings for every test: one BLAS thread, folders in memory, and reproducible Hypothesis examples without a clock.

A record waits for the disk at every commit, and a campaign of a test commits thousands of times: 9 ms each on a busy
disk, most of a test's time. No power is cut here but on paper (`tests/acquisition/platter.py`), so `tmp_path` is in
memory where there is room for it.

The machines that run these tests are shared, so a deadline would only measure the neighbours. A failing example
is printed with the line that reproduces it. The profile `fuzz` draws 100,000 new ones for each test (`make fuzz`),
`fuzz-short` 2,000 (`make long`).
"""

from __future__ import annotations

import gc
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Generator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; processes that tests start inherit it

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

MEMORY, ROOM = Path("/dev/shm"), 2e9  # bytes; a whole run of the suite leaves 0.2e9
if MEMORY.is_dir() and shutil.disk_usage(MEMORY).free > ROOM:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))  # pytest's own name for where `tmp_path` is
os.environ.setdefault(
    "PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir()
)  # not in the folder of `pytest_configure`

# Programs of ours start without the current folder (`-P`); some call functions of these tests
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")))
)

# What commands have written is kept beside the tests, not in the home of whoever runs them
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="truepose-state-")

_STARTS = re.compile(r"\b(served|in_a_browser|subprocess)\b")

settings.register_profile(
    "truepose",
    deadline=None,
    derandomize=True,
    database=None,
    print_blob=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "fuzz",
    settings.get_profile("truepose"),
    derandomize=False,
    max_examples=100_000,
    suppress_health_check=list(HealthCheck),
)
settings.register_profile("fuzz-short", settings.get_profile("fuzz"), max_examples=2_000)
settings.load_profile("truepose")

# Hypothesis mixes in numbers that it finds in the source of whatever modules are loaded: then the examples of a test
# depend on which tests ran before it in the same process, whatever `derandomize` says. There is no setting for it.
providers._get_local_constants = Constants


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--whole", action="store_true", help="what `make test` takes a sample of, in full")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What collecting leaves, half a million objects that stay, is not looked through again and again for garbage.

    That took an eighth of the processor time of tests that compute.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long come first: those that start a program or a browser, then those of many tests.

    Else a file of a minute begins as the last one. `make suite` shares the files out in this order
    (`--no-loadscope-reorder`).
    """
    tests = Counter(item.path for item in items)
    long = {
        path for path in tests if _STARTS.search(path.read_text("utf-8")) or path.parent.name == "end_to_end"
    }
    items.sort(key=lambda item: (item.path not in long, -tests[item.path]))


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("whole") and not item.config.getoption("whole"):
        pytest.skip("run by `make long` (--whole)")


def pytest_configure(config: pytest.Config) -> None:
    """Each process has a folder of its own for locks: others' simulated robots may bear the same serial number.

    Others of this run, and those of a second run that somebody else has begun on the same machine.
    """
    folder = tempfile.mkdtemp(prefix="truepose-tests-", dir=os.environ["PYTEST_DEBUG_TEMPROOT"])
    tempfile.tempdir = os.environ["TMPDIR"] = folder  # programs that tests start inherit it
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
