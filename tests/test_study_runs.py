import itertools
import json
import os
import shutil
import sqlite3
import time
from dataclasses import replace

import pytest
import toy_problem
from processes import ranking, table
from toy_problem import solved_keys, toy_run
from wording import says

from topo_search.model import Audit, BadInput, Design
from topo_search.model.files import read_json
from topo_search.model.task_file import read_task
from topo_search.study import COLUMNS, RunFolder, answer_of
from topo_search.study.relaxable_limits import RELAXING
from topo_search.study.request import Request


def test_a_run_leaves_what_the_format_says(tmp_path, log):
    answer = toy_run(tmp_path / "run")
    folder = tmp_path / "run"
    rows = list(table(folder).values())
    assert tuple(rows[0]) == COLUMNS
    assert answer.exit_status == 0
    objectives = [float(row["objective"]) for row in rows]
    assert objectives == sorted(objectives)
    assert sorted(solved_keys(log)) == sorted(row["key"] for row in rows)
    best = read_json(Design, folder / "best.json")
    assert best.topology.key == rows[0]["key"] == answer.best.key
    assert best.objective == objectives[0] == min(objectives)
    assert [float(row["gap"]) for row in rows] == [1 - toy_problem.BOUND / J for J in objectives]
    assert {path.stem for path in (folder / "designs").iterdir()} == {row["key"] for row in rows}
    audited = [row["key"] for row in rows if row["audit"]]
    assert audited == [row["key"] for row in rows[:10]]
    for key in audited:
        assert read_json(Audit, folder / "audits" / f"{key}.json").verdict == "clear"
    assert read_task(folder / "task.toml") == toy_problem.toy_task()
    assert answer.sizes[0].feasible == sum(int(row["orbit"]) for row in rows)
    solved = solved_keys(log)
    assert toy_run(tmp_path / "run") == answer
    assert solved_keys(log) == solved


def test_the_number_of_workers_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_VIOLATED", "*")
    monkeypatch.setenv("TOY_MARGIN", "1e-3")
    for workers in (1, 2):
        toy_run(tmp_path / str(workers), workers=workers)
    assert ranking(tmp_path / "1") == ranking(tmp_path / "2")
    texts = [json.loads((tmp_path / str(workers) / "best.json").read_text()) for workers in (1, 2)]
    assert texts[0] == texts[1]


def test_more_starts_extend_the_rows(tmp_path, log):
    toy_run(tmp_path / "grown", starts=2)
    toy_run(tmp_path / "grown", starts=6)
    toy_run(tmp_path / "whole", starts=6)
    grown, whole = ranking(tmp_path / "grown"), ranking(tmp_path / "whole")
    audit = [name for name in COLUMNS if name != "seconds"].index("audit")
    for row in (*grown, *whole):
        del row[audit]  # the ten best of two starts were audited too
    assert grown == whole
    assert (tmp_path / "grown" / "best.json").read_text() == (tmp_path / "whole" / "best.json").read_text()


def test_more_starts_ask_for_a_new_audit_only_where_they_found_a_better_design(tmp_path, monkeypatch):
    log = tmp_path / "audits"
    monkeypatch.setenv("TOY_AUDIT_LOG", str(log))
    toy_run(tmp_path / "run", starts=2)
    before = {key: float(row["objective"]) for key, row in table(tmp_path / "run").items()}
    assert sorted(log.read_text().split()) == sorted(before)
    log.write_text("")
    toy_run(tmp_path / "run", starts=6)
    better = [key for key, row in table(tmp_path / "run").items() if float(row["objective"]) < before[key]]
    assert 0 < len(better) < len(before)
    assert sorted(log.read_text().split()) == sorted(better)


def test_infeasible_candidates_give_the_smallest_shortfall(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    answer = toy_run(tmp_path / "run")
    rows = table(tmp_path / "run").values()
    assert answer.exit_status == 3
    assert {row["status"] for row in rows} == {"infeasible"}
    least = min(rows, key=lambda row: float(row["violation"]))
    missed = f"{least['key']} misses {least['worst_constraint']} by {float(least['violation']):.3g} N m"
    assert says(answer.sizes[0].reason, f"no start of {len(rows)} candidates", "not a proof", missed)
    assert not (tmp_path / "run" / "best.json").exists()


def test_a_proof_spares_the_solving(tmp_path, monkeypatch, log):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    answer = toy_run(tmp_path / "run")
    assert answer.exit_status == 3
    assert answer.sizes[0].reason == "three modules cannot lift what is asked"
    rows = table(tmp_path / "run").values()
    assert len(rows) == answer.sizes[0].candidates > 0
    assert {row["status"] for row in rows} == {"impossible"}
    assert len(set(solved_keys(log))) <= RELAXING.trees  # those whose limits are relaxed, to say what would help
    assert toy_run(tmp_path / "run") == answer


def test_failed_candidates_keep_their_reason_and_are_tried_again_by_the_next_call(tmp_path, monkeypatch, log):
    toy_run(tmp_path / "plain")
    keys = list(table(tmp_path / "plain"))
    for variable, key in zip(("TOY_SEGFAULT", "TOY_MEMORY", "TOY_RAISE"), keys, strict=False):
        monkeypatch.setenv(variable, key)
    log.write_text("")
    answer = toy_run(tmp_path / "run", workers=2)
    rows = table(tmp_path / "run")
    assert answer.best.key == keys[3]
    assert "SIGSEGV" in rows[keys[0]]["worst_constraint"]
    assert rows[keys[1]]["worst_constraint"].startswith("MemoryError")
    assert rows[keys[2]]["worst_constraint"] == "ValueError: `toy` must hold, but got no toy"
    assert {rows[key]["status"] for key in keys[:3]} == {"failed"}
    assert {rows[key]["status"] for key in keys[3:]} == {"feasible"}
    attempts = {key: solved_keys(log).count(key) for key in keys[:4]}
    assert attempts == dict(zip(keys, (2, 1, 1, 1), strict=False))
    assert any(remark.startswith(f"{keys[0]}: failed") for remark in answer.sizes[0].remarks)
    log.write_text("")
    assert toy_run(tmp_path / "run", workers=2) == answer
    assert {*solved_keys(log)} == {*keys[:3]}
    for variable in ("TOY_SEGFAULT", "TOY_MEMORY", "TOY_RAISE"):
        monkeypatch.delenv(variable)
    log.write_text("")
    cured = toy_run(tmp_path / "run")
    assert sorted(solved_keys(log)) == sorted(keys[:3])
    assert replace(cured, folder=tmp_path / "plain") == toy_run(tmp_path / "plain")
    log.write_text("")
    assert toy_run(tmp_path / "run") == cured
    assert solved_keys(log) == []


def test_sizes_are_searched_smallest_first_and_the_smallest_feasible_wins(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "2")
    answer = toy_run(tmp_path / "run", modules=(2, 4))
    folder = tmp_path / "run"
    assert [size.modules for size in answer.sizes] == [2, 3, 4]
    assert [size.best is None for size in answer.sizes] == [True, False, False]
    assert answer.best.modules == 3
    assert not (folder / "best-n2.json").exists()
    assert (folder / "best.json").read_text() == (folder / "best-n3.json").read_text()
    assert read_json(Design, folder / "best-n4.json").topology.n == 4
    sizes = [int(row["modules"]) for row in table(folder).values()]
    assert sizes == sorted(sizes)


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on by a second whenever it is looked at: once a job, and a few times beside."""
    ticks = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(ticks)))


def test_a_time_limit_keeps_what_ended_and_the_next_run_goes_on(tmp_path, log, clock):
    first = toy_run(tmp_path / "run", modules=4, time_limit=8.0).sizes[0]
    done = list(table(tmp_path / "run"))
    assert 0 < len(done) == first.settled < first.candidates
    assert (first.complete, first.starts) == (False, 0)
    log.write_text("")
    assert not toy_run(tmp_path / "run", modules=4, time_limit=8.0).sizes[0].complete
    assert not set(done) & set(solved_keys(log))
    assert toy_run(tmp_path / "run", modules=4).sizes[0].complete


def test_under_a_time_limit_every_candidate_gets_one_start_first(tmp_path, log, clock):
    size = toy_run(tmp_path / "run", modules=4, starts=6, time_limit=20.0).sizes[0]
    keys = solved_keys(log)
    assert len(keys) > size.candidates == len(set(keys[: size.candidates]))
    assert (size.settled, size.starts, size.complete) == (size.candidates, 1, False)
    assert {int(row["starts"]) for row in table(tmp_path / "run").values()} == {1, 2}


def test_sizes_share_the_time(tmp_path, clock):
    sizes = toy_run(tmp_path / "run", modules=(2, 4), starts=200, time_limit=120.0).sizes
    assert [size.settled for size in sizes] == [size.candidates for size in sizes]
    assert not any(size.complete for size in sizes)


def test_the_table_says_how_many_starts_reached_the_same_optimum(tmp_path):
    toy_run(tmp_path / "run", starts=9)
    toy_run(tmp_path / "run", starts=20)
    for row in table(tmp_path / "run").values():
        values = [toy_problem.value(row["key"], s, 0, 1e-4) for s in range(20)]
        assert float(row["objective"]) == (least := min(values))
        assert int(row["starts_at_best"]) == sum(J - least <= 1e-4 * least for J in values)


@pytest.fixture
def protected():
    """Make folders read-only, also for root, who gives up being root for the time."""
    was = os.geteuid()
    modes = {}

    def protect(*folders):
        for folder in folders:
            for path in (folder, *folder.rglob("*")):
                modes[path] = path.stat().st_mode
                path.chmod(0o555 if path.is_dir() else 0o444)
        if was == 0:
            for parent in folders[0].parents[:-1]:
                modes[parent] = parent.stat().st_mode
                parent.chmod(modes[parent] | 0o055)
            os.seteuid(65534)

    yield protect
    os.seteuid(was)
    for path, mode in modes.items():
        path.chmod(mode)


def test_a_finished_run_answers_from_a_read_only_folder(tmp_path, log, protected):
    answer = toy_run(tmp_path / "run")
    shutil.copytree(tmp_path / "run", tmp_path / "killed")
    database = sqlite3.connect(tmp_path / "run" / "ledger.sqlite", isolation_level=None)
    database.execute("UPDATE candidates SET seconds = 7")
    for name in ("ledger.sqlite", "ledger.sqlite-wal", "ledger.sqlite-shm"):  # as after kill -9
        shutil.copy(tmp_path / "run" / name, tmp_path / "killed" / name)
    database.close()
    log.write_text("")
    protected(tmp_path / "run", tmp_path / "killed")
    assert toy_run(tmp_path / "run").best == replace(answer.best, seconds=7.0)
    assert toy_run(tmp_path / "killed").best == replace(answer.best, seconds=7.0)
    with pytest.raises(BadInput, match="seed 0, not 1"):
        toy_run(tmp_path / "run", seed=1)
    with pytest.raises(BadInput, match=r"cannot be written to: .*; choose another folder with --out"):
        toy_run(tmp_path / "run", starts=3)
    assert solved_keys(log) == []


def test_a_folder_that_cannot_be_written_to_is_refused(tmp_path, protected):
    (tmp_path / "run").mkdir()
    protected(tmp_path / "run")
    with pytest.raises(BadInput, match=r"/run: cannot be written to: Permission denied; choose"):
        toy_run(tmp_path / "run")
    with pytest.raises(BadInput, match=r"^/proc/self: has .* but no ledger\.sqlite: .*; choose"):
        toy_run("/proc/self")
    with pytest.raises(BadInput, match=r"^/proc/nowhere/deep: cannot be created: No such file or directory;"):
        toy_run("/proc/nowhere/deep")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"modules": 4}, "another task"),
        ({"seed": 1}, "seed 0, not 1"),
        ({"symmetry": "none"}, "symmetry c2, not none"),
    ],
)
def test_a_folder_of_another_run_is_refused(tmp_path, change, message):
    toy_run(tmp_path / "run")
    before = {path: path.read_bytes() for path in (tmp_path / "run").glob("*.*") if "sqlite" not in path.name}
    with pytest.raises(BadInput, match=message):
        toy_run(tmp_path / "run", **change)
    assert before == {path: path.read_bytes() for path in before}
    assert toy_run(tmp_path / "run").exit_status == 0


@pytest.mark.parametrize(
    ("asked", "rule"),
    [
        ({"starts": 0}, "`1 <= starts <= 10,000` must hold, but got 0"),
        ({"strategy": "optuna", "trials": 0}, "`1 <= trials <= 100,000` must hold, but got 0"),
        ({"strategy": "Optuna"}, "strategy must be one of exhaustive, randomized, optuna, but got 'Optuna'"),
        ({"sampler": "cmaes"}, "sampler must be one of moves, tpe, nsga2, random, but got 'cmaes'"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_a_folder_is_made(tmp_path, asked, rule):
    with pytest.raises(ValueError, match=f"^{rule}$"):
        toy_run(tmp_path / "run", **asked)
    assert not list(tmp_path.iterdir())


def test_what_compiles_spends_no_time_limit(tmp_path, monkeypatch):
    now = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)

    def prepare():
        nonlocal now
        now += 500.0

    answer = toy_run(tmp_path / "run", prepare=prepare, time_limit=200.0)
    assert now == 500.0
    assert answer.complete
    assert answer.best is not None


# ---- A run's folder read again without its command: what was asked, what was found, and in which order.


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
