"""A separate scheduler with TLS and a PostgreSQL, as in a plant.

Workers of another program get no work, and a killed or unreachable process does not lose completed work.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

import pytest
from dask import config
from distributed import Client

from calib import DataError
from fleet.diagnose import DatasetSource, DiagnosisOrder, EngineGone, ProgressCounts, diagnose_all, in_store
from fleet.diagnose.engine import connected
from fleet.diagnose.run import FleetRun
from fleet.store import Document, FleetStore, dataset_content
from tests.drivers.nobody import nobody_listens
from tests.fleet.diagnose.certificates import make_certificates
from tests.fleet.diagnose.plant import address_in, as_in_the_manual, process, settings
from tests.fleet.diagnose.sets import bad
from tests.fleet.documents import BEGAN, ROBOT
from tests.fleet.postgres import Cluster

pytestmark = pytest.mark.usefixtures("patient")

OTHER = "0.0.9+other"
SETS = 40


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return make_certificates(tmp_path_factory.mktemp("tls") / "own")


def put(url: str, folder: Path) -> list[DatasetSource]:
    """Data sets that cannot be used, of which refusals are quickly made, in a store."""
    with FleetStore.open(url) as store:
        for i in range(SETS):
            data = bad(folder, f"bad{i}")
            content = dataset_content(data.read_text("utf-8"), data.with_suffix(".toml").read_text("utf-8"))
            store.add(Document("dataset", ROBOT, "cell-1", f"bad{i}", BEGAN, content))
        return in_store(store)


def results(order: DiagnosisOrder) -> Sequence[object]:
    with FleetStore.open(order.store) as store:
        return store.work.results(order.task)


def test_a_plant_with_a_killed_scheduler_and_a_database_that_goes(
    tmp_path: Path, postgres: Cluster, template: str, certificates: dict[str, Path]
) -> None:
    url = postgres.database(template)
    sources = put(url, tmp_path)
    order = DiagnosisOrder(url, "first", lease_s=1.0)
    told: list[str] = []
    with ExitStack() as running:
        said = tmp_path / "scheduler.json"
        scheduler = running.enter_context(
            process(*as_in_the_manual("scheduler", certificates, "--port", "0", "--protocol", "tls"),
                    "--scheduler-file", str(said))
        )  # fmt: skip
        address = address_in(said)
        tls = {f"DASK_DISTRIBUTED__COMM__TLS__{key}": str(certificates[name])
               for key, name in (("CA_FILE", "ca"), ("WORKER__CERT", "cert"), ("WORKER__KEY", "key"))}  # fmt: skip
        wrong = running.enter_context(
            process("tests.fleet.diagnose.programs", address, OTHER, environment=tls)
        )
        assert wrong.stdout is not None
        its_address = wrong.stdout.readline().strip()
        running.enter_context(
            process(*as_in_the_manual("worker", certificates, address, "--nthreads", "1", "--no-nanny"))
        )

        with (
            config.set(settings(make_certificates(tmp_path / "stranger"))),
            pytest.raises(EngineGone, match=r"no scheduler answers .*certificate"),
            connected(address),
        ):
            pass

        def kill(tally: ProgressCounts) -> None:
            if tally.done >= 2:
                scheduler.kill()

        with config.set(settings(certificates)), pytest.raises(EngineGone, match="scheduler is gone"):
            diagnose_all(sources, order, told.append, kill, scheduler=address)
    assert urlsplit(address).scheme == "tls"
    (refusal,) = [each for each in told if "refused" in each]
    assert its_address in refusal
    assert f"it runs TruePose {OTHER}" in refusal
    first = results(order)
    assert 2 <= len(first) < SETS

    stopped: list[int] = []
    said_again: list[str] = []

    def stop(tally: ProgressCounts) -> None:
        if not stopped and tally.done:
            stopped.append(tally.done)
            postgres.stop()

    def hear(sentence: str) -> None:
        said_again.append(sentence)
        if "does not answer" in sentence:
            postgres.start()

    tally = diagnose_all(sources, replace(order, owner="second"), hear, stop, workers=1)
    assert stopped[0] < SETS
    assert "Nothing that is done is lost" in said_again[0]
    assert said_again[1].startswith("the store answers again")
    assert (tally.left, tally.twice, tally.failed) == (0, 0, {})
    last = results(order)
    assert last[: len(first)] == first  # written once
    assert len(last) == SETS


@pytest.mark.parametrize(
    "told", [{}, {"workers": {"tcp://127.0.0.1:1": {}}}], ids=["nothing", "what it knew"]
)
def test_a_scheduler_that_goes_while_nothing_is_out_is_gone(tmp_path: Path, told: dict[str, Any]) -> None:
    """Nothing is cancelled then: Dask's client would take new work, and reconnect until it fails."""

    class Lost:
        status = "connecting"

        def scheduler_info(self, n_workers: int) -> dict[str, Any]:
            return told

    order = DiagnosisOrder(f"sqlite:///{tmp_path}/s.sqlite3", "this call")
    with pytest.raises(EngineGone, match="scheduler is gone"):
        FleetRun(cast(Client, Lost()), order, [DatasetSource("0" * 64, "a")], print).run(print)


def test_a_way_with_tls_needs_certificates_that_can_be_read(
    tmp_path: Path, certificates: dict[str, Path]
) -> None:
    (tmp_path / "ca.pem").write_text("no certificate", "utf-8")
    with nobody_listens() as port:
        address = f"tls://127.0.0.1:{port}"
        with pytest.raises(DataError, match="needs certificates"), connected(address):
            pass
        for name in ("ca.pem", "nowhere.pem"):
            files = dict.fromkeys(certificates, tmp_path / name)
            with (
                config.set(settings(files)),
                pytest.raises(DataError, match="certificates cannot be used"),
                connected(address),
            ):
                pass
