"""Dask workers that end, misfit or never come: nothing is lost, and the message says what to do."""

import importlib
import os
import signal
import threading
from collections import Counter

import distributed
import pytest
from dask_cluster import Cluster, free_port
from engine_jobs import LONG, cache_folder, environment, mark, misbehave, report_pid, square
from processes import eventually, gone

from topo_search.engine import DaskWorkers, Failed, WorkersLost, dask_workers
from topo_search.model import BadInput


def parent_of(pid):
    with open(f"/proc/{pid}/stat") as stat:
        return int(stat.read().rsplit(")", 1)[1].split()[1])


def test_killing_a_dask_worker_loses_nothing_and_leaves_no_child(cluster, tmp_path):
    with DaskWorkers(cluster.address, {}) as workers:
        results = workers.run(report_pid, [(tmp_path, 0.2)] * 12, deadline=lambda _: LONG)
        child = next(results)[1]
        os.kill(parent_of(child), signal.SIGKILL)
        rest = [result for _, result in results]
        assert len(rest) == 11
        assert not any(isinstance(result, Failed) for result in rest)
        eventually(lambda: gone(child))


def children(workers, folder):
    return [child for _, child in workers.run(report_pid, [(folder, 0.1)] * 4, deadline=lambda _: LONG)]


def test_quick_jobs_do_not_make_one_worker_take_all_the_slow_ones(cluster, tmp_path):
    jobs = [*[(tmp_path, 0.0)] * 20, *[(tmp_path, 0.2)] * 24]
    with DaskWorkers(cluster.address, {}) as workers:
        eventually(lambda: len(set(children(workers, tmp_path))) == 2)  # both have started
        results = workers.run(report_pid, jobs, deadline=lambda _: LONG)
        shares = Counter(child for (_, seconds), child in results if seconds)
    assert shares.total() == 24
    assert len(shares) == 2
    assert min(shares.values()) >= 8


def test_every_dask_worker_prepares_once_and_says_once_where_compiled_code_is(tmp_path):
    """Two threads have two children; nothing can be kept where only NUMBA_CACHE_DIR would do, which is not set."""
    noted, nowhere = [], {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "TMPDIR": str(tmp_path)}
    with (
        Cluster(tmp_path, **nowhere) as cluster,
        DaskWorkers(cluster.address, {}, note=noted.append) as workers,
    ):
        for _ in range(2):
            cluster.add_worker("--nthreads", "2")
        eventually(lambda: len(workers.threads()) == 2)
        marks = tmp_path / "marks"
        marks.mkdir()
        workers.prepare(mark, marks, noted.append)
        assert len(list(marks.iterdir())) == 2
        assert (tmp_path / "worker.log").read_text().count("marking") == 2
        assert noted == ["preparing 2 Dask workers"]
        folders = [folder for _, folder in workers.run(cache_folder, [0.2] * 8, deadline=lambda _: LONG)]
    assert set(folders) == {str(tmp_path / f"topo-search-{os.getuid()}")}
    assert (tmp_path / "worker.log").read_text().count("compiled functions are kept in") == 2


def test_a_child_keeps_memory_for_its_next_job(cluster):
    trim = "MALLOC_TRIM_THRESHOLD_"
    assert trim in distributed.config["distributed"]["nanny"]["pre-spawn-environ"]
    with DaskWorkers(cluster.address, {}) as workers:
        assert workers.run_one(environment, (trim,), deadline=LONG) == {trim: None}


def test_a_worker_that_joins_late_is_waited_for(tmp_path):
    noted = []
    with Cluster(tmp_path) as cluster, DaskWorkers(cluster.address, {}, note=noted.append) as workers:
        joins = threading.Timer(0.1, lambda: (eventually(lambda: noted), cluster.add_worker()))
        joins.start()
        assert workers.run_one(square, 3, deadline=LONG) == 9
        joins.join()
    assert len(noted) == 1
    assert f"{cluster.address} has no workers; waiting" in noted[0]


def test_no_scheduler_at_an_address(monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=1.0))
    address = f"tcp://127.0.0.1:{free_port()}"
    with DaskWorkers(address, {}) as workers:
        assert list(workers.run(square, [], deadline=lambda _: LONG)) == []  # nothing to do, nobody to ask
        with pytest.raises(WorkersLost, match=f"no Dask scheduler answers at {address}"):
            workers.run_one(square, 3, deadline=LONG)


@pytest.mark.parametrize("address", ["", "cluster", "127.0.0.1:8786", "http://127.0.0.1:80", "tcp://node"])
def test_what_is_no_address(address):
    with pytest.raises(BadInput, match=f"tcp://HOST:PORT, but got '{address}'"):
        DaskWorkers(address, {})


def test_dask_workers_that_may_have_no_child_are_refused_with_what_to_set(tmp_path):
    with Cluster(tmp_path, DASK_DISTRIBUTED__WORKER__DAEMON="True") as cluster:
        cluster.add_worker()
        with (
            DaskWorkers(cluster.address, {}) as workers,
            pytest.raises(WorkersLost, match="set DASK_DISTRIBUTED__WORKER__DAEMON=False in"),
        ):
            workers.run_one(square, 3, deadline=LONG)


def test_dask_workers_without_this_package_are_refused(tmp_path):
    (tmp_path / "lacking.py").write_text('import sys\nsys.modules["topo_search"] = None\n')
    with Cluster(tmp_path) as cluster:
        cluster.add_worker("--preload", "lacking.py", "--no-nanny")
        lacks = r"the Dask worker tcp://\S+ lacks topo-search-by-another-name: .* 0\.1"
        versions = {"topo-search-by-another-name": "0.1"}  # the metadata of topo-search itself is still to be seen
        with DaskWorkers(cluster.address, versions) as workers, pytest.raises(WorkersLost, match=lacks):
            workers.run_one(square, 3, deadline=LONG)


def test_a_function_that_dask_workers_lack_ends_the_run_and_fails_no_job(cluster, tmp_path, monkeypatch):
    (tmp_path / "only_here.py").write_text("def double(x):\n    return 2 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    double = importlib.import_module("only_here").double
    lacking = "Dask workers cannot import what they must run: No module named 'only_here'"
    with DaskWorkers(cluster.address, {}) as workers, pytest.raises(WorkersLost, match=lacking):
        workers.run_one(double, 3, deadline=LONG)


@pytest.fixture(scope="module")
def strict(tmp_path_factory):
    """A scheduler that forgives no job the end of its worker, with one worker."""
    with Cluster(tmp_path_factory.mktemp("strict"), DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as cluster:
        cluster.add_worker()
        yield cluster


def test_a_job_that_ends_its_dask_worker_takes_no_other_with_it(strict):
    jobs = [*("fine",) * 60, "parent", *("fine",) * 60]
    with DaskWorkers(strict.address, {}) as workers:
        found = dict(workers.run(misbehave, [(kind, x) for x, kind in enumerate(jobs)], deadline=lambda _: LONG))
    assert len(found) == 121
    failed = found.pop(("parent", 60))
    assert (failed.kind, failed.reason) == ("crash", "the Dask worker that ran it ended, 1 times in a row")
    assert found == {("fine", x): x for x in range(121) if x != 60}


def test_what_waits_for_a_job_that_ends_its_dask_worker_goes_on_when_that_has_failed(strict):
    found = []

    def chain():
        for x, kind in enumerate(["parent", "fine"]):
            while len(found) < x:
                yield None
            yield kind, x

    with DaskWorkers(strict.address, {}) as workers:
        for _, result in workers.run(misbehave, chain(), deadline=lambda _: LONG):
            found.append(isinstance(result, Failed))
    assert found == [True, False]
