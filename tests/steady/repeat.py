"""Pytest plugin: `--repeat 50` runs every chosen test 50 times, each as a separate case."""

from __future__ import annotations

import pytest

FIXTURE = "repetition_of_the_test"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--repeat", type=int, default=1, help="how often every test runs")


@pytest.fixture
def repetition_of_the_test(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.hookimpl(trylast=True)
def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    times: int = metafunc.config.option.repeat
    metafunc.fixturenames.append(FIXTURE)
    ids = [f"time {k}" for k in range(1, times + 1)]
    metafunc.parametrize(FIXTURE, range(times), ids=ids, indirect=True)
