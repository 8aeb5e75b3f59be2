import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from engine_jobs import LONG, misbehave, report_pid, square
from processes import eventually, gone

from topo_search.engine import CallingProcess, Failed, Workers, WorkersLost
from topo_search.experiments.study import peak_mb


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


def test_workers_that_cannot_start_end_the_run(monkeypatch):
    with Workers(1) as workers:
        monkeypatch.setattr("topo_search.engine.workers.os.getpid", lambda: -1)  # no parent has this id
        with pytest.raises(WorkersLost, match="3 times in a row"):
            workers.run_one(square, 3, deadline=LONG)


def test_workers_start_in_a_process_of_another_library(monkeypatch):
    """As joblib's, whose start method a new process does not know."""
    monkeypatch.setattr("multiprocessing.spawn.get_start_method", lambda: "loky")
    with Workers(1) as workers:
        assert workers.run_one(square, 3, deadline=LONG) == 9


@pytest.mark.parametrize("count", [0, 257])
def test_a_number_of_workers_that_cannot_be(count):
    with pytest.raises(ValueError, match=f"^`1 <= workers <= 256` must hold, but got {count}$"):
        Workers(count)


# ---- the calling process


def test_the_calling_process_gives_what_workers_give(tmp_path):
    with CallingProcess() as engine:
        assert list(engine.run(square, [1, 2, None, 3], deadline=lambda _: LONG)) == [(1, 1), (2, 4)]
        assert engine.run_one(report_pid, (tmp_path, 0.0), deadline=LONG) == os.getpid()
        assert list(engine.run(square, [1], deadline=lambda _: LONG, until=time.monotonic())) == []
        bad = engine.run_one(misbehave, ("raise", 0), deadline=LONG)
    assert bad == Failed("error", "ValueError: `x > 0` must hold, but got x = 0")


def test_an_interrupt_of_a_script_arrives_though_a_library_swallows_it():
    """CasADi takes KeyboardInterrupt for a failure of one step; it is known by the name of its modules."""
    steps = """
def swallow():
    for step in range(3):
        try:
            signal.raise_signal(signal.SIGINT) if step == 0 else time.sleep(0.2)
        except KeyboardInterrupt:
            steps.append(step)
"""
    library = {"__name__": "casadi.tools", "signal": signal, "time": time, "steps": []}
    exec(steps, library)
    with CallingProcess() as engine, pytest.raises(KeyboardInterrupt):
        engine.run_one(lambda _: (library["swallow"](), time.sleep(LONG)), 0, deadline=LONG)
    assert library["steps"] == []
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
from engine_jobs import square
from topo_search.engine import Workers
print("read")
with Workers(1) as workers:
    print(workers.run_one(square, 3, deadline=60.0))
"""


@pytest.mark.parametrize("start", [(), ("-m", "pdb", "-c", "continue")], ids=["python", "pdb"])
def test_workers_do_not_import_the_script_that_starts_them(tmp_path, start):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(folder=str(Path(__file__).parent)))
    command = [sys.executable, "-u", *start, script]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.stdout.startswith("read\n9\n"), done.stderr


# ---- test_engine_usage

BLOCK_MB = 400.0
SAY = "from topo_search.experiments.study import peak_mb; print(peak_mb())"


def test_a_process_counts_its_own_memory_and_not_that_of_its_parent():
    before = peak_mb()
    assert np.ones(int(BLOCK_MB * 2**20 / 8)).nbytes / 2**20 == BLOCK_MB
    assert peak_mb() > BLOCK_MB
    assert peak_mb() >= before
    child = float(subprocess.run([sys.executable, "-c", SAY], check=True, capture_output=True).stdout)
    assert 5 < child < BLOCK_MB / 2
