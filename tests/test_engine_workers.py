import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from multiprocessing import util
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest
from engine_jobs import LONG, environment, mark, misbehave, raise_timeout, report_pid, square
from processes import eventually, gone

from topo_search.engine import CallingProcess, Failed, Workers, WorkersLost
from topo_search.supervisor import ONE_THREAD, Clock, peak_mb


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
        first = workers.run_one(report_pid, (tmp_path, 0.0), deadline=LONG)
        os.kill(first, signal.SIGKILL)
        eventually(lambda: gone(first))
        assert workers.run_one(square, 3, deadline=LONG) == 9


def test_no_worker_is_left_behind_after_an_error_of_the_caller(tmp_path):
    def caller():
        with Workers(2) as workers:
            next(workers.run(report_pid, [(tmp_path, 0.1)] * 10, deadline=lambda _: LONG))
            raise RuntimeError("the caller's own")

    with pytest.raises(RuntimeError, match="the caller's own"):
        caller()
    eventually(lambda: all(gone(int(path.name)) for path in tmp_path.iterdir()))


@pytest.mark.parametrize("count", [1, 2])
def test_what_compiles_is_told_before_and_a_single_worker_does_it(tmp_path, count):
    told = []

    def note(text):
        told.append((text, len(list(tmp_path.iterdir()))))

    with Workers(count) as workers:
        workers.prepare(mark, tmp_path, note)
    assert told == [("marking", 0)]
    (marked,) = tmp_path.iterdir()
    assert (marked.name == str(os.getpid())) == (count > 1)


def die_elsewhere(caller, note):
    """Die, except in the caller."""
    if os.getpid() != caller:
        os.kill(os.getpid(), signal.SIGKILL)
    note("compiling")


def divide_by(number, note):
    return 1 / number


def test_the_caller_compiles_what_a_worker_cannot():
    messages = []
    with Workers(1) as workers:
        workers.prepare(die_elsewhere, os.getpid(), messages.append)
        with pytest.raises(ZeroDivisionError):
            workers.prepare(divide_by, 0, messages.append)
    assert messages == ["compiling"]


def test_threads_are_as_many_as_before_outside_of_workers():
    before = dict(os.environ)
    with Workers(1) as workers:
        assert workers.run_one(environment, tuple(ONE_THREAD), deadline=LONG) == ONE_THREAD
    assert dict(os.environ) == before


def test_workers_that_cannot_start_end_the_run(monkeypatch):
    with Workers(1) as workers:
        monkeypatch.setattr("topo_search.engine.workers.os.getpid", lambda: -1)  # no parent has this id
        with pytest.raises(WorkersLost, match="3 times in a row"):
            workers.run_one(square, 3, deadline=LONG)


def test_a_clock_that_jumps_ends_no_job(tmp_path, monkeypatch):
    """The pool measures deadlines by the time of day, which here jumps forward in each of the first three tries."""
    real = time.time

    def jumping():
        begun = [real() - path.stat().st_mtime > 0.3 for path in tmp_path.iterdir()]  # by then the pool knows
        return real() + 1000.0 * min(sum(begun), 3)

    monkeypatch.setattr(time, "time", jumping)
    with Workers(1) as workers:
        ((_, result),) = workers.run(report_pid, [(tmp_path, 1.0)], deadline=lambda _: 500.0)
    assert not isinstance(result, Failed)
    assert 2 <= len(os.listdir(tmp_path)) <= 4  # on a busy machine a jump may come before a job's time begins


def test_a_job_that_raises_a_timeout_of_its_own_fails():
    with Workers(1) as workers:
        ((_, result),) = workers.run(raise_timeout, [1], deadline=lambda _: LONG)
    assert isinstance(result, Failed)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_between_the_start_of_a_process_and_what_it_is_told_waits(monkeypatch, capfd, number):
    started, start = [], util.spawnv_passfds

    def stopped_then(path, words, kept):
        started.append(start(path, words, kept))
        if "--multiprocessing-fork" in words:
            signal.raise_signal(number)
        return started[-1]

    monkeypatch.setattr(util, "spawnv_passfds", stopped_then)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), Workers(2) as workers:
            workers.run_one(square, 3, deadline=LONG)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert started
    with suppress(ChildProcessError):  # the pool has waited for it
        os.waitpid(started[-1], 0)
    assert capfd.readouterr().err == ""


def test_a_worker_that_starts_while_the_pool_stops_ends_without_a_word(monkeypatch, capfd):
    """The pool drops its locks first; the signal that ends the worker comes here when it has looked for them."""
    terminate = BaseProcess.terminate

    def late(process):
        with suppress(AssertionError):
            eventually(lambda: not process.is_alive(), seconds=10.0)
        terminate(process)

    monkeypatch.setattr(BaseProcess, "terminate", late)
    with Workers(1) as workers:
        assert not list(workers.run(square, [3], deadline=lambda _: LONG, until=time.monotonic() + 0.01))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("count", [0, 257])
def test_a_number_of_workers_that_cannot_be(count):
    with pytest.raises(ValueError, match=f"^`1 <= workers <= 256` must hold, but got {count}$"):
        Workers(count)


# ---- the calling process


def test_the_calling_process_gives_what_workers_give(tmp_path):
    with CallingProcess() as engine:
        assert list(engine.run(square, [1, 2, None, 3], deadline=lambda _: LONG)) == [(1, 1), (2, 4)]
        assert engine.run_one(report_pid, (tmp_path, 0.0), deadline=LONG) == os.getpid()
        assert engine.run_one(environment, tuple(ONE_THREAD), deadline=LONG) == ONE_THREAD
        assert list(engine.run(square, [1], deadline=lambda _: LONG, until=time.monotonic())) == []
        bad = [engine.run_one(misbehave, (kind, 0), deadline=LONG) for kind in ("raise", "memory")]
    assert [failed.kind for failed in bad] == ["error", "memory"]
    assert bad[0].reason == "ValueError: `x > 0` must hold, but got x = 0"


def interrupted(times):
    """Take so many interrupts for a failure of one step, as CasADi does."""
    for step in range(times):
        with suppress(KeyboardInterrupt):
            if step == 0:
                signal.raise_signal(signal.SIGINT)
            time.sleep(LONG)
    time.sleep(LONG)


def test_an_interrupt_of_a_script_arrives_though_a_library_swallows_it():
    handlers = [signal.signal(number, signal.default_int_handler) for number in (signal.SIGINT, signal.SIGALRM)]
    try:
        with CallingProcess() as engine, pytest.raises(KeyboardInterrupt):
            engine.run_one(interrupted, 3, deadline=LONG)
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        for number, handler in zip((signal.SIGINT, signal.SIGALRM), handlers, strict=True):
            signal.signal(number, handler)


SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
from engine_jobs import square
from topo_search.engine import Workers
print("read")
with Workers(1) as workers:
    print(workers.run_one(square, 3, deadline=60.0))
"""


def test_workers_do_not_import_the_script_that_starts_them(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(folder=str(Path(__file__).parent)))
    done = subprocess.run([sys.executable, "-u", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "read\n9\n", "")


def test_a_lost_pool_is_told_without_the_frames_that_noticed_it(monkeypatch):
    monkeypatch.setattr(Workers, "_submit", lambda *_: _lose())
    with pytest.raises(WorkersLost) as lost, Workers(1) as workers:
        workers.run_one(square, 3, deadline=LONG)
    assert [frame.name for frame in lost.traceback][-1] == "__exit__"
    assert len(lost.traceback) == 2


def _lose():
    raise WorkersLost("no worker process could be started")


# ---- test_engine_usage

BLOCK_MB = 400.0
SAY = "from topo_search.supervisor import peak_mb; print(peak_mb())"


def test_a_process_counts_its_own_memory_and_not_that_of_its_parent():
    before = peak_mb()
    assert np.ones(int(BLOCK_MB * 2**20 / 8)).nbytes / 2**20 == BLOCK_MB
    assert peak_mb() > BLOCK_MB
    assert peak_mb() >= before
    child = float(subprocess.run([sys.executable, "-c", SAY], check=True, capture_output=True).stdout)
    assert 5 < child < BLOCK_MB / 2


def test_a_lap_begins_where_the_last_one_ended():
    clock = Clock()
    assert sum(range(3_000_000)) > 0
    worked, rested = clock.lap(), clock.lap()
    assert worked > rested >= 0
