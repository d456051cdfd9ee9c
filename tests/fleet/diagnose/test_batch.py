"""A batch in a worker: each result is stored once, at once, and only if it is about data."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import DataError, Dataset, DiagnosisFit
from calib.diagnose import diagnose
from fleet.diagnose import DatasetSource, DiagnosisOrder, EngineGone, in_files
from fleet.diagnose.batch import work_off
from fleet.errors import StoreGone
from fleet.store import FleetStore, utc_now
from tests.drivers.waiting import in_thread, until
from tests.fleet.diagnose.sets import bad, good


class Counted:
    """Diagnosis that is computed once for all, and counts its requests."""

    _known: DiagnosisFit | None = None

    def __init__(self) -> None:
        self.calls: list[str] = []

    def __call__(self, dataset: Dataset, most: int) -> DiagnosisFit:
        self.calls.append(dataset.header.text.splitlines()[0])
        if Counted._known is None:
            Counted._known = diagnose(dataset, most=most)
        return replace(Counted._known, dataset=dataset)


@pytest.fixture
def order(tmp_path: Path) -> DiagnosisOrder:
    return DiagnosisOrder(f"sqlite:///{tmp_path}/s.sqlite3", "this call", most=1)


def results(order: DiagnosisOrder) -> dict[str, dict[str, Any]]:
    with FleetStore.open(order.store) as store:
        return {each.job.data: json.loads(each.content) for each in store.work.results(order.task)}


def sources_of(folder: Path, count: int) -> list[DatasetSource]:
    return in_files([good(folder, f"set{i}") for i in range(count)])


def test_every_result_is_kept_and_none_is_computed_again(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources, find = [*sources_of(tmp_path, 2), *in_files([bad(tmp_path, "bad")])], Counted()
    first = work_off(sources, order, find)
    assert (first.done, first.refused, first.found, first.twice) == (3, 1, 0, 0)
    assert first.seconds > 0.0
    kept = results(order)
    assert [kept[source.hash]["verdict"] for source in sources] == ["attributed", "attributed", "refused"]
    again = work_off(sources, replace(order, owner="another call"), find)
    assert (again.done, again.found, again.twice, again.held) == (0, 3, 0, ())
    assert find.calls == ["# set0", "# set1"]
    assert results(order) == kept


def test_a_statement_says_what_the_diagnosis_says(tmp_path: Path, order: DiagnosisOrder) -> None:
    (source,) = sources_of(tmp_path, 1)
    work_off([source], order)
    table = results(order)[source.hash]
    with FleetStore.open(order.store) as store:
        (kept,) = store.work.results(order.task)
    assert kept.job == order.job(source)
    assert 0.0 < kept.seconds < 600.0
    (effect,) = table["effects"]
    assert (effect["label"], effect["unit"], effect["rivals"]) == ("backlash:j4", "deg", [])
    assert table["readings"] == 40
    assert table["held_out"] == table["error_after_mm"]["n"] == 20
    assert table["error_after_mm"]["rms"] < 0.5 * table["error_before_mm"]["rms"]
    assert table["simulated"]


def test_a_refusal_says_where_and_what_to_do_and_names_no_folder(
    tmp_path: Path, order: DiagnosisOrder
) -> None:
    table = bad(tmp_path, "bad")
    work_off(in_files([table]), order)
    (refusal,) = results(order).values()
    assert refusal["what"]
    assert refusal["do"]
    assert refusal["name"] == str(table)


def test_settings_and_programs_have_results_of_their_own(
    tmp_path: Path, order: DiagnosisOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources, find = sources_of(tmp_path, 1), Counted()
    assert work_off(sources, order, find).done == 1
    assert work_off(sources, replace(order, most=2), find).done == 1
    monkeypatch.setattr("fleet.diagnose.batch.this_program", lambda: "9.9.9+other")
    assert work_off(sources, replace(order, expected="9.9.9+other"), find).done == 1


def test_another_program_is_refused_before_anything_is_read(tmp_path: Path, order: DiagnosisOrder) -> None:
    find = Counted()
    with pytest.raises(EngineGone, match=r"this is 9\.9\.9"):
        work_off(sources_of(tmp_path, 1), replace(order, expected="9.9.9"), find)
    assert find.calls == []
    assert results(order) == {}


def test_what_another_call_works_on_is_left_to_it(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources, find = sources_of(tmp_path, 2), Counted()
    with FleetStore.open(order.store) as store:
        store.work.claim([order.job(sources[0])], "another call", utc_now(), 600.0)
        outcome = work_off(sources, order, find)
        assert (outcome.done, outcome.held) == (1, (sources[0],))
        assert find.calls == ["# set1"]
        # its worker was lost, and its claim with it
        store.work.claim([order.job(sources[0])], "another call", utc_now(), 0.0)
    assert work_off(sources, order, find).done == 1


def test_a_claim_is_renewed_as_long_as_the_work_takes(tmp_path: Path, order: DiagnosisOrder) -> None:
    def term() -> str:
        with closing(sqlite3.connect(tmp_path / "s.sqlite3")) as store:
            return str(store.execute("SELECT until FROM claim").fetchone()[0])

    def slow(dataset: Dataset, most: int) -> DiagnosisFit:
        first = term()
        until(lambda: term() > first)
        return Counted()(dataset, most)

    sources = sources_of(tmp_path, 1)
    assert work_off(sources, replace(order, lease_s=0.3), slow).done == 1
    last = term()
    work_off(sources, replace(order, lease_s=0.3))
    assert term() == last  # nobody goes on renewing


def test_a_result_that_comes_late_changes_nothing(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources = sources_of(tmp_path, 1)

    def overtaken(dataset: Dataset, most: int) -> DiagnosisFit:
        with FleetStore.open(order.store) as store:
            assert store.work.finish(order.job(sources[0]), "faster", b'{"verdict": "first"}', utc_now(), 1.0)
        return Counted()(dataset, most)

    outcome = work_off(sources, order, overtaken)
    assert (outcome.done, outcome.twice) == (0, 1)
    assert results(order) == {sources[0].hash: {"verdict": "first"}}


def test_what_was_finished_before_the_program_failed_is_kept(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources, find = sources_of(tmp_path, 3), Counted()

    def failing(dataset: Dataset, most: int) -> DiagnosisFit:
        if "# set1" in dataset.header.text:
            raise np.linalg.LinAlgError("SVD did not converge")
        return find(dataset, most)

    with pytest.raises(np.linalg.LinAlgError):
        work_off(sources, order, failing)
    assert list(results(order)) == [sources[0].hash]
    outcome = work_off(sources, order, find)
    assert (outcome.done, outcome.found) == (2, 1)


def test_files_that_have_changed_get_no_result(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources, find = sources_of(tmp_path, 2), Counted()
    good(tmp_path, "set0").write_text("something else", "utf-8")
    outcome = work_off(sources, order, find)
    assert outcome.done == 1
    ((source, why),) = outcome.unseen
    assert source == sources[0]
    assert "changed since" in why
    assert list(results(order)) == [sources[1].hash]


def test_a_store_that_is_gone_is_no_refusal_of_the_data(
    tmp_path: Path, order: DiagnosisOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> bytes:
        raise StoreGone("does not answer.", do="Ask again.")

    monkeypatch.setattr(FleetStore, "content", gone)
    with pytest.raises(StoreGone):
        work_off([DatasetSource("0" * 64, "a")], order)
    monkeypatch.undo()
    assert results(order) == {}
    with pytest.raises(DataError, match="folder does not exist"):
        work_off(sources_of(tmp_path, 1), replace(order, store="sqlite:////nowhere/s.sqlite3"))


def test_two_workers_with_one_batch_give_every_result_once(tmp_path: Path, order: DiagnosisOrder) -> None:
    sources = in_files([bad(tmp_path, f"bad{i}") for i in range(6)])
    both = [in_thread(partial(work_off, sources, replace(order, owner=owner))) for owner in ("a", "b")]
    outcomes = [each.result() for each in both]
    assert sum(each.done for each in outcomes) == len(results(order)) == 6
    assert sum(each.twice for each in outcomes) == 0
