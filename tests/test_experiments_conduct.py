import csv
import os
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import toy_problem
from commands import invoke
from processes import eventually, gone

from topo_search.compose import BACKENDS
from topo_search.engine import Failed, Job
from topo_search.experiments import Settings, conduct, experiment, results
from topo_search.experiments.study import (
    AIRFLOW_ALONE,
    COLUMNS,
    Variant,
    identity,
    measure,
    open_record,
    roots,
    trees,
)
from topo_search.model import BadInput, Design, Topology
from topo_search.topologies import candidates

TOY = Settings(tasks=(("push", (3, 4)), ("push-local", (4,))), topologies=(3, 3), starts=2)
TOY_SCRIPT = """
import sys, toy_problem
from test_experiments_conduct import TOY
from topo_search.experiments import conduct, experiment
conduct(experiment("scaling"), TOY, sys.argv[1], workers=1, backends=toy_problem.BACKENDS)
"""
MEASURED = ["solve_s", "audit_s", "peak_mb"]


def table(folder):
    with (folder / "results.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def planned(settings, *variants, name="scaling"):
    return replace(experiment(name), variants=variants or experiment(name).variants).cells(settings)


def test_a_plan_has_every_tree_under_every_condition():
    settings = Settings((("push", (3,)), ("ten-wrenches", (3, 4))), (4, 4), 1, (0.2, 0.3))
    cells = planned(settings, Variant("one"), Variant("two", ("search.margin=0",)))
    assert len(cells) == (4 * 2 + 4) * 2 * 2
    assert len({identity(cell.row) for cell in cells}) == len(cells)
    assert [cell.n for cell in cells] == sorted(cell.n for cell in cells)
    assert {cell.key for cell in cells if cell.n == 3} == {candidate.key for candidate in candidates(3)}
    assert {cell.task_seed for cell in cells if cell.task == "push"} == {None}
    seeds = {cell.key: cell.task_seed for cell in cells if cell.task == "ten-wrenches" and cell.n == 4}
    assert sorted(seeds.values()) == [0, 1, 2, 3]
    for cell in cells:
        task = cell.resolve()
        assert task.module.connector_distance == cell.distance_m
        assert task.search.margin == (0.0 if cell.variant.name == "two" else 1e-4)


def test_trees_are_all_or_as_many_different_ones_as_asked_for():
    assert trees(4, 14, 0) == [candidate.key for candidate in candidates(4)]
    drawn = trees(4, 13, 0)
    assert len(set(drawn)) == 13
    assert drawn[:5] == trees(4, 5, 0) != trees(4, 5, 1)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_roots_of_all_trees_are_all_rooted_trees(n):
    found = [key for tree in candidates(n) for key in roots(tree.key)]
    assert sorted(found) == [rooted.key for rooted in candidates(n, symmetry="none", root="paper")]


def test_the_paper_s_root_is_tried_at_every_module_of_the_sampled_trees():
    cells = planned(Settings((("push", (5,)),), (3, 3), 1), name="root")
    free, paper = ([cell for cell in cells if cell.variant.name == name] for name in ("free root", "paper root"))
    assert [cell.key for cell in paper] == [key for cell in free for key in roots(cell.key)]
    assert {cell.resolve().search.root for cell in paper} == {"paper"}


def test_a_cell_is_solved_and_audited_as_alone():
    settings = Settings((("push", (3,)),), (4, 4), 3, (0.2,))
    cell = next(cell for cell in planned(settings, Variant("airflow", (AIRFLOW_ALONE,))) if cell.key == "a300")
    row = measure(BACKENDS, settings, False, cell)
    alone = BACKENDS.solve(Job(cell.resolve(), Topology.from_key(cell.key), starts=range(3), seed=0))
    assert isinstance(alone, Design)
    assert (row["status"], row["verdict"], row["starts"]) == ("feasible", "clear", 3)
    assert (row["objective"], row["lower_bound"], row["gap"]) == (alone.objective, alone.lower_bound, alone.gap)
    assert (row["colliding_pairs"], row["largest_cluster"], row["depths_percent"]) == (0, 0, "")
    assert row["solve_s"] > 0
    assert row["audit_s"] > 0
    assert 10 < row["peak_mb"] < 10_000
    assert set(row) <= set(COLUMNS)


def test_without_airflow_constraints_the_row_has_the_metrics_of_the_audit():
    settings = Settings((("ten-wrenches", (5,)),), (1, 1), 2)
    (cell,) = planned(settings, name="ablation")
    row = measure(BACKENDS, settings, True, cell)
    starts = range(row["starts"] - 1, row["starts"])
    audit = BACKENDS.audit(BACKENDS.solve(Job(cell.resolve(), Topology.from_key(cell.key), starts=starts, seed=0)))
    envelope = cell.resolve().module.envelope
    depths = [-pair.analytic_m / (2 * envelope.end_radius) * 100 for pair in audit.pairs if pair.kind == "airflow"]
    assert row["colliding_pairs"] == sum(depth > 0 for depth in depths) > 0
    assert row["deepest_percent"] == pytest.approx(max(depths))
    told = [float(depth) for depth in row["depths_percent"].split()]
    assert told == pytest.approx(sorted((depth for depth in depths if depth > 0), reverse=True), abs=0.06)
    assert 2 <= row["largest_cluster"] <= 5
    assert row["verdict"] == "clear"


def test_the_first_design_or_the_time_limit_ends_a_cell_if_asked_to(monkeypatch):
    settings = Settings((("push", (3,)),), (1, 1), 4)
    (cell,) = planned(settings)
    assert measure(toy_problem.BACKENDS, settings, True, cell)["starts"] == 1
    assert measure(toy_problem.BACKENDS, settings, False, cell)["starts"] == 4
    monkeypatch.setenv("TOY_NONE", "*")
    row = measure(toy_problem.BACKENDS, settings, True, cell)
    assert (row["status"], row["starts"], row["iterations"], row["unit"]) == ("infeasible", 4, 4, "N m")
    assert measure(toy_problem.BACKENDS, replace(settings, time_limit=1e-9), True, cell)["starts"] == 1


def test_a_failed_cell_counts_nowhere_and_is_tried_again(tmp_path, monkeypatch):
    key = trees(3, 2, 0)[0]

    class Failing(toy_problem.InProcess):
        def run(self, function, jobs, **limits):
            for job in jobs:
                yield job, Failed("crash", "ended by SIGKILL") if job.key in failing else function(job)

    monkeypatch.setattr("topo_search.experiments.conduct", partial(conduct, backends=toy_problem.BACKENDS))
    monkeypatch.setattr("topo_search.experiments.study.Workers", Failing)
    command = ["experiment", "scaling", "--small", "--task", "ten-wrenches:3", "--out", str(tmp_path)]
    failing = trees(3, 2, 0)
    assert "all 2 cells failed: ended by SIGKILL" in invoke(*command, status=70).output
    failing = [key]
    assert "1 of 2 cells failed and are left out" in invoke(*command).output
    rows = results(tmp_path)
    assert rows[rows["status"] == "failed"]["worst_constraint"].tolist() == ["ended by SIGKILL"]
    failing = []
    invoke(*command)
    assert results(tmp_path)["status"].tolist() == ["feasible"] * 2


def test_a_variant_that_does_not_fit_its_task_is_refused_before_any_work(tmp_path):
    wrong = replace(experiment("scaling"), variants=(Variant("no such", ("search.nothing=1",)),))
    with pytest.raises(BadInput, match="nothing"):
        conduct(wrong, TOY, tmp_path / "out", backends=toy_problem.BACKENDS)
    assert not (tmp_path / "out").exists()


def test_a_killed_experiment_skips_finished_rows_and_a_torn_one_is_cut_off(tmp_path, monkeypatch):
    whole, killed, log = tmp_path / "whole", tmp_path / "killed", tmp_path / "log"
    with monkeypatch.context() as here:
        here.setattr("topo_search.experiments.study.Workers", toy_problem.InProcess)
        expected = conduct(experiment("scaling"), TOY, whole, backends=toy_problem.BACKENDS)
    here = {**os.environ, "PYTHONPATH": f"{Path(__file__).parent}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-c", TOY_SCRIPT, str(killed)]
    process = subprocess.Popen(command, env={**here, "TOY_LOG": str(log), "TOY_SLEEP": "0.3"})
    eventually(lambda: (killed / "results.csv").exists() and len(table(killed)) >= 2)
    pids = {int(line.split()[2]) for line in log.read_text().splitlines()}
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    eventually(lambda: all(map(gone, pids)))
    done = table(killed)
    assert 2 <= len(done) < len(expected)
    with (killed / "results.csv").open("a") as stream:
        stream.write("airflow,push,0.15,3,a3")
    subprocess.run(command, env=here, check=True)
    assert table(killed)[: len(done)] == done
    by = ["n", "task", "key"]
    ended, expected = (
        rows.drop(columns=MEASURED).sort_values(by, ignore_index=True) for rows in (results(killed), expected)
    )
    assert ended.equals(expected)


def test_a_folder_of_other_conditions_is_refused_by_their_name_and_left_as_it_is(tmp_path):
    def refused(words, name="scaling", **changes):
        with pytest.raises(BadInput, match=words), open_record(tmp_path, name, replace(TOY, **changes), "command"):
            pass

    with open_record(tmp_path, "scaling", TOY, "command"):
        pass
    before = {path: path.read_bytes() for path in tmp_path.glob("*.*")}
    refused("has rows with starts 2, not 7", starts=7)
    refused('has rows with experiment "scaling", not "ablation"', name="ablation")
    assert {path: path.read_bytes() for path in tmp_path.glob("*.*")} == before


def test_the_command_prints_the_summary_draws_and_resumes(tmp_path, monkeypatch):
    monkeypatch.setattr("topo_search.experiments.study.Workers", toy_problem.InProcess)
    command = ["experiment", "ablation", "--small", "--topologies", "1", "--out", str(tmp_path / "a")]
    picture = tmp_path / "a.svg"
    assert "share_colliding" in invoke(*command, "--picture", picture).output
    assert picture.read_text().count("modules") >= 3
    before = (tmp_path / "a" / "results.csv").read_bytes()
    assert '"summary"' in invoke(*command, "--json").stdout
    assert (tmp_path / "a" / "results.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sizes", "0"], "must be N,..., each above 0"),
        (["--topologies", "1,2,3"], "must be one or two numbers, but got 3"),
        (["--task", "push:0"], "must be TASK:N,N,..., each N at most 200, but got push:0"),
        (["--task", "pusch:3"], "nor a shipped example; did you mean `push`"),
        (["--picture", "a.jpg"], "must end in .png, .svg or .pdf, but got a.jpg"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, words):
    assert words in invoke("experiment", "scaling", "--out", tmp_path / "out", *options, status=2).output
    assert not (tmp_path / "out").exists()
