"""A run on a Dask cluster gives the same answer as one here; a lost worker or scheduler costs no result."""

import os
import signal
import subprocess
import sys
import threading

import pytest
from dask_cluster import Cluster, free_port
from engine_jobs import LONG, environment, mark, misbehave, report_pid, square
from processes import eventually, gone, ranking, recorded
from toy_problem import solved_keys, toy_run

from topo_search.engine import DaskWorkers, Failed, WorkersLost
from topo_search.model import BadInput


def parent_of(pid):
    with open(f"/proc/{pid}/stat") as stat:
        return int(stat.read().rsplit(")", 1)[1].split()[1])


def test_killing_a_dask_worker_loses_nothing_and_leaves_no_child(cluster, tmp_path):
    with DaskWorkers(cluster.address) as workers:
        results = workers.run(report_pid, [(tmp_path, 0.2)] * 12, deadline=lambda _: LONG)
        child = next(results)[1]
        os.kill(parent_of(child), signal.SIGKILL)
        rest = [result for _, result in results]
        assert len(rest) == 11
        assert not any(isinstance(result, Failed) for result in rest)
        eventually(lambda: gone(child))


def test_dask_workers_prepare_and_keep_memory_for_the_next_job(cluster, tmp_path):
    noted, trim = [], "MALLOC_TRIM_THRESHOLD_"
    with DaskWorkers(cluster.address) as workers:
        workers.prepare(mark, tmp_path, noted.append)
        assert list(tmp_path.iterdir())
        assert workers.run_one(environment, (trim,), deadline=LONG) == {trim: None}
    assert noted == ["preparing the Dask workers"]


def test_a_job_that_ends_its_dask_worker_fails_and_the_next_one_runs(tmp_path):
    """A worker that joins late is waited for."""
    noted = []
    with Cluster(tmp_path, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as cluster:
        joins = threading.Thread(target=lambda: (eventually(lambda: noted), cluster.add_worker()))
        joins.start()
        with DaskWorkers(cluster.address, note=noted.append) as workers:
            failed = workers.run_one(misbehave, ("parent", 0), deadline=LONG)
            assert workers.run_one(square, 3, deadline=LONG) == 9
        joins.join()
    assert (failed.kind, failed.reason) == ("crash", "the Dask worker that ran it ended, 1 times in a row")
    assert len(noted) == 1
    assert f"{cluster.address} has no workers; waiting" in noted[0]


@pytest.mark.parametrize("address", ["", "127.0.0.1:8786", "http://127.0.0.1:80"])
def test_what_is_no_address(address):
    with pytest.raises(BadInput, match=f"tcp://HOST:PORT, but got '{address}'"):
        DaskWorkers(address)


def test_dask_workers_that_may_have_no_child_are_refused_with_what_to_set(tmp_path):
    with Cluster(tmp_path, DASK_DISTRIBUTED__WORKER__DAEMON="True") as cluster:
        cluster.add_worker()
        with DaskWorkers(cluster.address) as workers, pytest.raises(WorkersLost, match="WORKER__DAEMON=False"):
            workers.run_one(square, 3, deadline=LONG)


@pytest.mark.parametrize("options", [{"modules": 4}, {"modules": 6, "strategy": "optuna", "trials": 24}])
def test_the_toy_problem_has_the_same_answer_on_both_engines(cluster, tmp_path, options):
    toy_run(tmp_path / "here", workers=2, **options)
    with DaskWorkers(cluster.address) as engine:
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
        with DaskWorkers(cluster.address) as engine, pytest.raises(WorkersLost, match=gone):
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


def test_no_scheduler_is_a_line_and_a_status(tmp_path):
    address = f"tcp://127.0.0.1:{free_port()}"
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", "run", "push", "--modules", "2", "--dask", address],
        cwd=tmp_path,
        env={**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "0.5s"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 70, done.stderr
    assert f"no Dask scheduler answers at {address}: " in done.stderr.splitlines()[-1]
    assert "the same command" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_workers_are_not_chosen_with_a_scheduler(run_toy):
    assert (
        "workers: cannot be chosen with dask" in run_toy("--dask", "tcp://a:1", "--workers", "2", status=2).stderr
    )


def test_without_the_extra_the_message_names_it(run_toy, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert 'pip install "topo-search[cluster]"' in run_toy("--dask", "tcp://node7:8786", status=2).stderr
