"""A run's folder read again without its command: what was asked, what was found, and in which order."""

import os
import time

import pytest
from toy_problem import solved_keys, toy_run

from topo_search.model import BadInput
from topo_search.study import RunFolder, answer_of
from topo_search.study.request import Request


def test_the_folder_alone_tells_what_was_asked_and_found(tmp_path):
    answer = toy_run(tmp_path / "run", modules=(2, 3), symmetry="none", starts=3, seed=7)
    with RunFolder.load(tmp_path / "run") as folder:
        request = folder.request
        assert (request.symmetry, request.starts, request.seed) == ("none", 3, 7)
        assert answer_of(folder) == answer


def test_solves_come_in_the_order_in_which_they_ended(tmp_path, monkeypatch):
    log = tmp_path / "log"
    monkeypatch.setenv("TOY_LOG", str(log))
    began = time.time()
    toy_run(tmp_path / "run", starts=1)
    toy_run(tmp_path / "run", starts=2)
    with RunFolder.load(tmp_path / "run") as folder:
        assert folder.request.starts == 2  # the last that was asked for
        solves, rows = list(folder.ledger.solves(3)), {row.key: row for row in folder.ledger.ranking(3)}
    assert [solve.key for solve in solves] == solved_keys(log)
    assert len(solves) == 2 * len(rows)
    times = [solve.at for solve in solves]
    assert times == sorted(times)
    assert began <= times[0] <= times[-1] <= time.time()
    assert [solve.objective for solve in solves[len(rows) :]] == [
        rows[solve.key].objective for solve in solves[len(rows) :]
    ]
    for first, second in zip(solves[: len(rows)], solves[len(rows) :], strict=True):
        assert first.objective >= second.objective


def test_rows_of_other_library_versions_are_found_too(tmp_path, monkeypatch):
    answer = toy_run(tmp_path / "run")
    monkeypatch.setattr("topo_search.study.request.metadata.version", lambda name: "99")
    assert Request.__dataclass_fields__["versions"].default_factory()["casadi"] == "99"
    with RunFolder.load(tmp_path / "run") as folder:
        assert "99" not in folder.request.versions.values()
        assert answer_of(folder) == answer


def test_a_proof_is_no_solve(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    toy_run(tmp_path / "run")
    with RunFolder.load(tmp_path / "run") as folder:
        assert list(folder.ledger.solves(3)) == []
        assert {row.status for row in folder.ledger.ranking(3)} == {"impossible"}


def test_a_folder_without_a_ledger_is_refused_and_left_as_it_is(tmp_path):
    with pytest.raises(BadInput, match=r"is not a run folder: it has no ledger\.sqlite"), RunFolder.load(tmp_path):
        pass
    assert os.listdir(tmp_path) == []


def test_the_report_gets_the_finished_folder(tmp_path):
    seen = []
    toy_run(tmp_path / "run", report=lambda folder: seen.extend(path.name for path in folder.path.iterdir()))
    assert {"best.json", "candidates.csv", "designs"} <= set(seen)
