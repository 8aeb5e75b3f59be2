import os
import signal
import threading
import time
from pathlib import Path

import pytest
from processes import eventually, gone

from topo_search.engine import Failed, Workers, WorkersLost
from topo_search.engine.child import ONE_THREAD

LONG = 600.0
"""No honest job of these tests takes as long [s]."""


def square(x):
    return x * x


def misbehave(job):
    kind, x = job
    if kind == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "memory":
        raise MemoryError
    if kind == "raise":
        raise ValueError("`x > 0` must hold,\nbut got x = 0")
    while kind == "hang":
        time.sleep(0.1)
    return x


def crash_once(path):
    """Die the first time, and leave a mark."""
    if not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "survived"


def count_attempts(path):
    with Path(path).open("a") as stream:
        stream.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def environment(_):
    return {name: os.environ.get(name) for name in ONE_THREAD}


def report_pid(job):
    path, seconds = job
    (Path(path) / str(os.getpid())).touch()
    time.sleep(seconds)
    return os.getpid()


@pytest.mark.parametrize("count", [1, 2])
def test_every_job_comes_back_once(count):
    with Workers(count) as workers:
        results = sorted(workers.run(square, range(20), deadline=lambda _: LONG))
    assert results == [(x, x * x) for x in range(20)]


def test_jobs_are_drawn_only_as_workers_take_them():
    drawn = []

    def endless():
        x = 0
        while True:
            drawn.append(x)
            yield x
            x += 1

    with Workers(2) as workers:
        outcomes = workers.run(square, endless(), deadline=lambda _: LONG)
        for _ in range(10):
            next(outcomes)
        outcomes.close()
    assert len(drawn) <= 10 + 2 * (2 * 2)


def test_one_bad_job_of_each_kind_leaves_the_others_alone():
    kinds = ["fine", "segfault", "fine", "kill", "memory", "fine", "hang", "raise", "fine"]
    jobs = [(kind, number) for number, kind in enumerate(kinds)]
    with Workers(2) as workers:
        deadline = {"hang": 1.0}
        found = dict(workers.run(misbehave, jobs, deadline=lambda job: deadline.get(job[0], LONG)))
    assert len(found) == len(jobs)
    for (kind, number), result in found.items():
        if kind == "fine":
            assert result == number
        else:
            assert isinstance(result, Failed)
    by_kind = {kind: result for (kind, _), result in found.items() if kind != "fine"}
    assert {kind: failed.kind for kind, failed in by_kind.items()} == {
        "segfault": "crash",
        "kill": "crash",
        "memory": "memory",
        "hang": "timeout",
        "raise": "error",
    }
    assert "SIGSEGV" in by_kind["segfault"].reason
    assert "SIGKILL" in by_kind["kill"].reason
    assert by_kind["raise"].reason == "ValueError: `x > 0` must hold, but got x = 0"


def test_a_single_worker_that_hangs_is_stopped_too():
    with Workers(1) as workers:
        assert workers.one(misbehave, ("hang", 0), deadline=1.0).kind == "timeout"
        assert workers.one(misbehave, ("fine", 7), deadline=LONG) == 7


def test_a_crash_is_tried_twice_and_no_more(tmp_path):
    with Workers(1) as workers:
        assert workers.one(crash_once, tmp_path / "mark", deadline=LONG) == "survived"
        assert isinstance(workers.one(count_attempts, tmp_path / "attempts", deadline=LONG), Failed)
    assert (tmp_path / "attempts").read_text() == "xx"


def test_killing_a_worker_from_outside_costs_one_retry(tmp_path):
    jobs = [(tmp_path, 0.5)] * 6
    with Workers(2) as workers:

        def kill_one():
            eventually(lambda: any(tmp_path.iterdir()))
            os.kill(int(next(tmp_path.iterdir()).name), signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        results = [result for _, result in workers.run(report_pid, jobs, deadline=lambda _: LONG)]
        killer.join()
    assert len(results) == 6
    assert not any(isinstance(result, Failed) for result in results)


def test_killing_idle_workers_is_repaired(tmp_path):
    with Workers(2) as workers:
        first = workers.one(report_pid, (tmp_path, 0.0), deadline=LONG)
        os.kill(first, signal.SIGKILL)
        eventually(lambda: gone(first))
        assert workers.one(square, 3, deadline=LONG) == 9


def test_the_time_limit_drops_what_runs(tmp_path):
    with Workers(1) as workers:
        jobs = [(tmp_path, 0.0), (tmp_path, 3600.0), (tmp_path, 0.0)]
        outcomes = workers.run(report_pid, jobs, deadline=lambda _: 2 * 3600.0, until=time.monotonic() + 2)
        pids = [result for _, result in outcomes]
        assert len(pids) <= 1
        eventually(lambda: all(gone(int(path.name)) for path in tmp_path.iterdir()))
        assert workers.one(square, 3, deadline=LONG) == 9


def test_no_worker_is_left_behind_after_an_error_of_the_caller(tmp_path):
    def caller():
        with Workers(2) as workers:
            next(workers.run(report_pid, [(tmp_path, 0.1)] * 10, deadline=lambda _: LONG))
            raise RuntimeError("the caller's own")

    with pytest.raises(RuntimeError, match="the caller's own"):
        caller()
    eventually(lambda: all(gone(int(path.name)) for path in tmp_path.iterdir()))


def test_libraries_use_one_thread_in_workers_and_as_many_as_before_outside():
    before = dict(os.environ)
    with Workers(1) as workers:
        assert workers.one(environment, None, deadline=LONG) == ONE_THREAD
    assert dict(os.environ) == before


def test_workers_that_cannot_start_end_the_run(monkeypatch):
    with Workers(1) as workers:
        monkeypatch.setattr("topo_search.engine.workers.os.getpid", lambda: -1)  # no parent has this id
        with pytest.raises(WorkersLost, match="3 times in a row"):
            workers.one(square, 3, deadline=LONG)


def test_at_least_one_worker():
    with pytest.raises(ValueError, match=r"`workers >= 1` must hold, but got 0"):
        Workers(0)
