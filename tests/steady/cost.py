"""Pytest plugin: `-p tests.steady.cost` shows the processor time of each file.

The time of the processes that it started is included. A process that outlives the process that started it, such as
one of a browser, is not counted.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Generator

import pytest


def _spent() -> float:
    return sum(os.times()[:4])  # seconds: user, system, and the children's


class Cost:
    """Processor time from report to report, set-up and teardown included."""

    def __init__(self) -> None:
        self._last = _spent()
        self._files: defaultdict[str, float] = defaultdict(float)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report, before = (yield), self._last
        self._last = _spent()
        spent: list[tuple[str, object]] = [("spent", self._last - before)]
        report.user_properties = spent
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        ((_, spent),) = report.user_properties
        assert isinstance(spent, float)
        self._files[report.location[0]] += spent

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for file, seconds in sorted(self._files.items(), key=lambda each: -each[1]):
            terminalreporter.write_line(f"{seconds:8.1f} s  {file}")
        terminalreporter.write_line(f"{sum(self._files.values()):8.1f} s of the processor")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Cost())
