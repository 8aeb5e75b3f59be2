"""What every engine promises, local workers and Dask workers alike."""

import time

import pytest
from engine_jobs import (
    LONG,
    TooLarge,
    count_attempts,
    crash_once,
    environment,
    misbehave,
    pause,
    report_pid,
    square,
)
from processes import eventually, gone

from topo_search.engine import DaskWorkers, Failed, Workers
from topo_search.process import ONE_THREAD


@pytest.fixture(scope="module", params=["local", "dask"])
def engine(request):
    """Two workers."""
    if request.param == "local":
        with Workers(2) as workers:
            yield workers
    else:
        with DaskWorkers(request.getfixturevalue("cluster").address) as workers:
            yield workers


def test_every_job_comes_back_once(engine):
    results = sorted(engine.run(square, range(200), deadline=lambda _: LONG))
    assert results == [(x, x * x) for x in range(200)]
    assert list(engine.run(square, [], deadline=lambda _: LONG)) == []


def test_jobs_are_drawn_only_as_workers_take_them(engine):
    drawn = []

    def endless():
        x = 0
        while True:
            drawn.append(x)
            yield x, 0.3
            x += 1

    outcomes = engine.run(pause, endless(), deadline=lambda _: LONG)
    for _ in range(6):
        next(outcomes)
    outcomes.close()
    assert len(drawn) <= 6 + 2 * 2


def test_what_depends_on_a_result_is_drawn_once_that_was_yielded(engine):
    squares = []

    def chain():
        for x in range(6):
            while len(squares) < x - 1:  # two at a time
                yield None
            yield x

    for _, result in engine.run(square, chain(), deadline=lambda _: LONG):
        squares.append(result)
    assert sorted(squares) == [0, 1, 4, 9, 16, 25]


def test_one_bad_job_of_each_kind_leaves_the_others_alone(engine):
    kinds = ["fine", "segfault", "fine", "kill", "fine", "hang", "raise", "fine"]
    jobs = [(kind, number) for number, kind in enumerate(kinds)]
    deadline = {"hang": 1.0}
    found = dict(engine.run(misbehave, jobs, deadline=lambda job: deadline.get(job[0], LONG)))
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
        "hang": "timeout",
        "raise": "error",
    }
    assert "SIGSEGV" in by_kind["segfault"].reason
    assert "SIGKILL" in by_kind["kill"].reason
    assert by_kind["raise"].reason == "ValueError: `x > 0` must hold, but got x = 0"


def test_a_job_that_does_not_fit_in_a_worker_fails_alone(engine):
    found = list(engine.run(type, [TooLarge(), 1, TooLarge(), 2.0], deadline=lambda _: LONG))
    assert {result for _, result in found if not isinstance(result, Failed)} == {int, float}
    failed = [result for _, result in found if isinstance(result, Failed)]
    assert failed == [Failed("error", "MemoryError:")] * 2


def test_a_single_job_that_hangs_is_stopped_too(engine):
    assert engine.run_one(misbehave, ("hang", 0), deadline=1.0).kind == "timeout"
    assert engine.run_one(misbehave, ("fine", 7), deadline=LONG) == 7


def test_a_crash_is_tried_twice_and_no_more(engine, tmp_path):
    assert engine.run_one(crash_once, tmp_path / "mark", deadline=LONG) == "survived"
    assert isinstance(engine.run_one(count_attempts, tmp_path / "attempts", deadline=LONG), Failed)
    assert (tmp_path / "attempts").read_text() == "xx"


def test_the_time_limit_drops_what_runs(engine, tmp_path):
    jobs = [(tmp_path, 0.0), (tmp_path, 3600.0), (tmp_path, 3600.0), (tmp_path, 0.0)]
    outcomes = engine.run(report_pid, jobs, deadline=lambda _: 2 * 3600.0, until=time.monotonic() + 4)
    assert len(list(outcomes)) <= 2
    eventually(lambda: all(gone(int(path.name)) for path in tmp_path.iterdir()))
    assert engine.run_one(square, 3, deadline=LONG) == 9


def test_libraries_use_one_thread(engine):
    assert engine.run_one(environment, tuple(ONE_THREAD), deadline=LONG) == ONE_THREAD
