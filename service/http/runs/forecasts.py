"""Forecasts of runs, made in a worker process as soon as one is free. The runs begin meanwhile."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from acquisition.run import Forecast, forecast_of
from service.http.work.workers import Workers


class Forecasts:
    """A forecast that is refused, because too much is being computed, leaves its run without one."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._thread = ThreadPoolExecutor(1, "forecasts")  # it waits for the worker

    def __call__(self, record: Path) -> Future[Forecast]:
        """Begin one; its future raises RecordError, StorageError, Problem, WorkerDied."""
        return self._thread.submit(self._workers.call, forecast_of, record)
