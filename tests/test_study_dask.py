"""A run on a Dask cluster: the same answer as on this machine, whatever becomes of the cluster."""

import os
import signal
import sys
import threading

import pytest
from dask_cluster import Cluster, free_port
from processes import eventually, ranking, recorded
from toy_problem import solved_keys, toy_run

from topo_search.engine import DaskWorkers, WorkersLost, dask_workers


@pytest.mark.parametrize("options", [{"modules": 4}, {"modules": 6, "strategy": "optuna", "trials": 24}])
def test_the_toy_problem_has_the_same_answer_on_both_engines(cluster, tmp_path, options):
    toy_run(tmp_path / "here", workers=2, **options)
    with DaskWorkers(cluster.address, {}) as engine:
        toy_run(tmp_path / "there", engine=engine, **options)
    assert ranking(tmp_path / "here") == ranking(tmp_path / "there")
    assert (tmp_path / "here" / "best.json").read_text() == (tmp_path / "there" / "best.json").read_text()


def test_a_scheduler_that_ends_loses_nothing_and_the_run_goes_on_without_it(tmp_path, monkeypatch):
    log, folder = tmp_path / "log", tmp_path / "run"
    monkeypatch.setenv("TOY_LOG", str(log))
    with Cluster(tmp_path, TOY_SLEEP="0.3") as cluster:
        cluster.add_worker()

        def end():
            eventually(lambda: len(recorded(folder)) >= 3)
            os.kill(cluster.scheduler.pid, signal.SIGKILL)

        threading.Thread(target=end).start()
        gone = f"the Dask scheduler at {cluster.address} is gone"
        with DaskWorkers(cluster.address, {}) as engine, pytest.raises(WorkersLost, match=gone):
            toy_run(folder, modules=4, engine=engine)
    kept = recorded(folder)
    assert {row[0] for row in ranking(folder)} == set(kept)
    log.write_text("")
    toy_run(folder, modules=4)
    assert not set(kept) & set(solved_keys(log))
    toy_run(tmp_path / "whole", modules=4)
    assert ranking(folder) == ranking(tmp_path / "whole")


def test_the_command_searches_on_a_cluster_and_answers_without_it_once_it_has_ended(cluster, run_toy):
    first = run_toy("--dask", cluster.address)
    assert run_toy("--dask", f"tcp://127.0.0.1:{free_port()}").stdout == first.stdout


def test_no_scheduler_is_a_status_of_its_own(run_toy, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=0.5))
    address = f"tcp://127.0.0.1:{free_port()}"
    result = run_toy("--dask", address, status=70)
    assert f"no Dask scheduler answers at {address}: " in result.stderr
    assert "the same command" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--dask", "node7"), "dask: must be the address of a Dask scheduler, tcp://HOST:PORT, but got 'node7'"),
        (("--dask", "tcp://node7:8786", "--workers", "2"), "workers: cannot be chosen with dask"),
    ],
)
def test_what_does_not_go_together_is_bad_input(run_toy, tmp_path, words, message):
    assert message in run_toy(*words, status=2).stderr
    assert not (tmp_path / "runs").exists()


def test_without_the_extra_the_message_names_it(run_toy, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = run_toy("--dask", "tcp://node7:8786", status=2)
    assert (
        '--dask: needs distributed, which is not installed; run: pip install "topo-search[cluster]"'
        in result.stderr
    )
