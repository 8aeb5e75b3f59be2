import csv
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from unittest.mock import patch

import pytest
import toy_problem
from commands import invoke
from processes import eventually, gone

from topo_search.compose import BACKENDS
from topo_search.engine import Failed, Job
from topo_search.experiments import Settings, conduct, experiment, results
from topo_search.experiments.conducting import measure
from topo_search.experiments.plan import AIRFLOW_ALONE, Variant, plan, trees
from topo_search.model import BadInput, Design, Topology
from topo_search.topologies import candidates

TASKS = (("push", (3, 4)), ("push-local", (4,)))
TOY = Settings(tasks=TASKS, topologies=(3, 3), starts=2)
TOY_SCRIPT = """
import sys, toy_problem
from topo_search.experiments import Settings, conduct, experiment
tasks = (("push", (3, 4)), ("push-local", (4,)))
conduct(experiment("scaling"), Settings(tasks, (3, 3), 2), sys.argv[1], workers=1, backends=toy_problem.BACKENDS)
"""
MEASURED = ("solve_s", "audit_s", "peak_mb")


def toy_rows(folder, settings=TOY, name="scaling"):
    with patch("topo_search.experiments.conducting.Workers", toy_problem.InProcess):
        return conduct(experiment(name), settings, folder, backends=toy_problem.BACKENDS)


def table(folder):
    with (folder / "results.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_plan_has_every_tree_under_every_condition():
    variants = (Variant("one"), Variant("two", ("search.margin=0",)))
    cells = plan(Settings((("push", (3,)), ("ten-wrenches", (3, 4))), (4, 4), 1, (0.2, 0.3)), variants, first=True)
    assert len(cells) == (4 * 2 + 4) * 2 * 2
    assert len({tuple(cell.identity.values()) for cell in cells}) == len(cells)
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


def test_a_cell_is_solved_and_audited_as_alone():
    cells = plan(
        Settings((("push", (3,)),), (4, 4), 3, (0.2,)), (Variant("airflow", (AIRFLOW_ALONE,)),), first=False
    )
    cell = next(cell for cell in cells if cell.key == "a300")
    row = measure(BACKENDS, cell)
    alone = BACKENDS.solve(Job(cell.resolve(), Topology.from_key(cell.key), starts=range(3), seed=0))
    assert isinstance(alone, Design)
    assert (row.status, row.verdict, row.starts) == ("feasible", "clear", 3)
    assert (row.objective, row.lower_bound, row.gap) == (alone.objective, alone.lower_bound, alone.gap)
    assert (row.colliding_pairs, row.largest_cluster, row.deepest_percent, row.depths_percent) == (0, 0, 0.0, None)
    assert row.solve_s > 0
    assert row.audit_s > 0
    assert 10 < row.peak_mb < 10_000


def test_without_airflow_constraints_the_row_has_the_metrics_of_the_audit():
    (cell,) = experiment("ablation").cells(Settings((("ten-wrenches", (5,)),), (1, 1), 2))
    row = measure(BACKENDS, cell)
    starts = range(row.starts - 1, row.starts)
    audit = BACKENDS.audit(BACKENDS.solve(Job(cell.resolve(), Topology.from_key(cell.key), starts=starts, seed=0)))
    envelope = cell.resolve().module.envelope
    depths = [-pair.analytic_m / (2 * envelope.end_radius) * 100 for pair in audit.pairs if pair.kind == "airflow"]
    assert row.colliding_pairs == sum(depth > 0 for depth in depths) > 0
    assert row.deepest_percent == pytest.approx(max(depths))
    told = [float(depth) for depth in row.depths_percent.split()]
    assert told == pytest.approx(sorted((depth for depth in depths if depth > 0), reverse=True), abs=0.06)
    assert 2 <= row.largest_cluster <= 5
    assert row.verdict == "clear"


def test_the_first_design_ends_a_cell_only_if_it_is_asked_to(monkeypatch):
    settings = Settings((("push", (3,)),), (1, 1), 4)
    first, every = (plan(settings, (Variant("airflow"),), first=first)[0] for first in (True, False))
    assert measure(toy_problem.BACKENDS, first).starts == 1
    assert measure(toy_problem.BACKENDS, every).starts == 4
    monkeypatch.setenv("TOY_NONE", "*")
    row = measure(toy_problem.BACKENDS, first)
    assert (row.status, row.starts, row.iterations, row.unit) == ("infeasible", 4, 4, "N m")
    assert row.worst_constraint.startswith("load case")


def test_no_start_is_begun_after_the_time_limit(monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    settings = Settings((("push", (3,)),), (1, 1), 4, time_limit=1e-9)
    (cell,) = plan(settings, (Variant("airflow"),), first=True)
    assert measure(toy_problem.BACKENDS, cell).starts == 1


@pytest.mark.parametrize("failing", ["some", "all"])
def test_a_failed_cell_counts_nowhere_and_is_tried_again(tmp_path, monkeypatch, failing):
    key = trees(3, 3, 0)[0]

    class Failing(toy_problem.InProcess):
        def run(self, function, jobs, **limits):
            for job in jobs:
                yield (
                    job,
                    Failed("memory", "out of memory") if failing == "all" or job.key == key else function(job),
                )

    asked = experiment("scaling")
    monkeypatch.setattr("topo_search.experiments.conduct", partial(conduct, backends=toy_problem.BACKENDS))
    command = ["experiment", "scaling", "--small", "--task", "ten-wrenches:3", "--out", str(tmp_path)]
    with monkeypatch.context() as broken:
        broken.setattr("topo_search.experiments.conducting.Workers", Failing)
        done = invoke(*command, status=70 if failing == "all" else 0)
    rows = results(tmp_path)
    failed = (rows["status"] == "failed").sum()
    if failing == "all":
        assert f"all {len(rows)} cells failed: out of memory" in done.output
    else:
        assert 0 < failed < len(rows)
        assert set(rows[rows["status"] == "failed"]["worst_constraint"]) == {"out of memory"}
        answered = rows[rows["status"] != "failed"]
        assert asked.summary(answered)["share_solved"].eq(1.0).all()
        assert f"{failed} of {len(rows)} cells failed and are left out" in done.output
        assert f"{len(answered)} of {len(answered)} problems have a design" in done.output
    monkeypatch.setattr("topo_search.experiments.conducting.Workers", toy_problem.InProcess)
    invoke(*command)
    assert (results(tmp_path)["status"] == "feasible").sum() == len(rows) == len(results(tmp_path))


def test_a_variant_that_does_not_fit_its_task_is_refused_before_any_work(tmp_path):
    bad = (Variant("no such", ("search.nothing=1",)),)
    asked = experiment("scaling")
    wrong = type(asked)(**{**vars(asked), "cells": lambda settings: plan(settings, bad, first=True)})
    with pytest.raises(BadInput, match="nothing"):
        conduct(wrong, TOY, tmp_path / "out", backends=toy_problem.BACKENDS)
    assert not (tmp_path / "out").exists()


def test_a_killed_experiment_goes_on_where_it_was(tmp_path):
    whole, killed, log = tmp_path / "whole", tmp_path / "killed", tmp_path / "log"
    expected = toy_rows(whole)
    here = {**os.environ, "PYTHONPATH": str(Path(__file__).parent), "TOY_LOG": str(log), "TOY_SLEEP": "0.3"}
    command = [sys.executable, "-c", TOY_SCRIPT, str(killed)]
    process = subprocess.Popen(command, env=here)
    eventually(lambda: (killed / "results.csv").exists() and len(table(killed)) >= 2)
    pids = {int(line.split()[2]) for line in log.read_text().splitlines()}
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    eventually(lambda: all(map(gone, pids)))
    done = table(killed)
    assert 2 <= len(done) < len(expected)
    before = len(toy_problem.solved_keys(log))
    subprocess.run(command, env={**here, "TOY_SLEEP": "0"}, check=True)
    assert table(killed)[: len(done)] == done
    ended = results(killed).drop(columns=list(MEASURED))
    assert ended.sort_values(["n", "task", "key"], ignore_index=True).equals(
        expected.drop(columns=list(MEASURED)).sort_values(["n", "task", "key"], ignore_index=True)
    )
    loads = 3  # a new worker loads what it needs for a task and size
    assert len(toy_problem.solved_keys(log)) - before <= len(expected) - len(done) + loads


def test_the_command_prints_the_summary_draws_and_resumes(tmp_path, monkeypatch):
    monkeypatch.setattr("topo_search.experiments.conducting.Workers", toy_problem.InProcess)
    command = ["experiment", "ablation", "--small", "--topologies", "1", "--out", str(tmp_path / "a")]
    picture = tmp_path / "a.svg"
    assert "share_colliding" in invoke(*command, "--picture", picture).output
    assert picture.read_text().count("modules") >= 3
    before = (tmp_path / "a" / "results.csv").read_bytes()
    assert '"findings"' in invoke(*command, "--json").stdout
    assert (tmp_path / "a" / "results.csv").read_bytes() == before
    assert "holds an experiment with starts 2, not 7" in invoke(*command, "--starts", "7", status=2).output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sizes", "ten"], "must be comma-separated numbers"),
        (["--topologies", "1,2,3"], "must be one or two numbers, but got 3"),
        (["--task", "push"], "must be TASK:N,N,..., but got push"),
        (["--task", "push:3", "--task", "push:4"], "--task: must have no value twice, but got push 2 times"),
        (["--distances", "0.3,0.3"], "--distances: must have no value twice, but got 0.3 2 times"),
        (["--time-limit", "inf"], "inf is not in the range 0<x<=1000000000"),
        (["--time-limit", "nan"], "'--time-limit': must be a number, but got nan"),
        (["--sizes", "0"], "--sizes: must be positive and finite, but got 0"),
        (["--topologies", "0,1"], "--topologies: must be positive and finite, but got 0"),
        (["--distances", "nan"], "--distances: must be positive and finite, but got nan"),
        (["--task", "pusch:3"], "--task: must name a shipped example, but got pusch; did you mean `push`"),
        (["--picture", "a.jpg"], "must end in .png or .svg, but got a.jpg"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, words):
    assert words in invoke("experiment", "scaling", "--out", tmp_path / "out", *options, status=2).output
    assert not (tmp_path / "out").exists()
