"""Dask schedulers that say nothing, workers that do not come back, and other versions: an error in stated time."""

import os
import signal
import socket
import socketserver
import subprocess
import sys
import threading
import time
from importlib import metadata

import pytest
from dask_cluster import Cluster
from engine_jobs import LONG, pause, square
from processes import eventually
from wording import says

from topo_search.engine import DaskWorkers, WorkersLost, computing_versions, dask_workers
from topo_search.engine.dask_workers import COMPUTING


@pytest.fixture
def listener():
    """Something that accepts connections and never answers."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(120)
        yield listener


@pytest.fixture
def mute(listener):
    """Its address."""
    return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def test_a_scheduler_that_accepts_and_says_nothing_is_given_up(mute, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=1.0))
    with (
        DaskWorkers(mute, {}) as workers,
        pytest.raises(WorkersLost, match=f"no Dask scheduler answers at {mute}: "),
    ):
        workers.run_one(square, 3, deadline=LONG)


@pytest.mark.parametrize("speaks_first", [True, False])
def test_another_program_at_the_port_is_no_scheduler(monkeypatch, speaks_first):
    """As a web server, whose answer to Dask's greeting reads as the length of a message that fills all memory."""

    class Web(socketserver.BaseRequestHandler):
        def handle(self):
            if speaks_first or self.request.recv(1):
                self.request.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=2.0))
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Web) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_address[1]}"
        with DaskWorkers(address, {}) as workers, pytest.raises(WorkersLost, match="no Dask scheduler answers at"):
            workers.run_one(square, 3, deadline=LONG)
        server.shutdown()


def test_a_scheduler_that_falls_silent_is_given_up(tmp_path, monkeypatch):
    with Cluster(tmp_path) as cluster, DaskWorkers(cluster.address, {}) as workers:
        cluster.add_worker()
        assert workers.run_one(square, 3, deadline=LONG) == 9
        monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=1.0))
        os.kill(cluster.scheduler.pid, signal.SIGSTOP)
        with pytest.raises(WorkersLost, match="has not answered for 1 s"):
            workers.run_one(square, 3, deadline=LONG)
        os.kill(cluster.scheduler.pid, signal.SIGCONT)


def test_a_scheduler_that_ends_while_a_call_waits_is_gone_at_once(tmp_path, monkeypatch):
    """The call's own stream may try to connect for as long as an answer is waited for."""
    with Cluster(tmp_path) as cluster, DaskWorkers(cluster.address, {}) as workers:
        cluster.add_worker()
        assert workers.run_one(square, 3, deadline=LONG) == 9
        ending = threading.Event()
        monkeypatch.setattr(workers.client(), "nthreads", ending.wait)
        threading.Timer(0.5, cluster.scheduler.kill).start()
        with pytest.raises(WorkersLost, match="is gone"):
            workers.threads()
        ending.set()


def test_workers_that_do_not_come_back_are_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(away=1.0))
    noted = []
    with Cluster(tmp_path) as cluster, DaskWorkers(cluster.address, {}, note=noted.append) as workers:
        worker = cluster.add_worker()
        results = workers.run(pause, [(x, 0.3) for x in range(100)], deadline=lambda _: LONG)
        next(results)
        os.killpg(worker.pid, signal.SIGKILL)
        with pytest.raises(WorkersLost, match=r"no worker has returned to the Dask scheduler at .* in 1 s"):
            list(results)
    assert f"{cluster.address}; waiting 1 s" in noted[-1]


def test_a_scheduler_that_is_restarted_without_workers_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(away=1.0))
    with Cluster(tmp_path) as cluster, DaskWorkers(cluster.address, {}) as workers:
        worker = cluster.add_worker()
        assert workers.run_one(square, 3, deadline=LONG) == 9
        os.killpg(worker.pid, signal.SIGKILL)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)
        cluster.scheduler.wait()
        cluster.start_scheduler()
        eventually(lambda: workers.is_connected, 60)
        with pytest.raises(WorkersLost, match=r"is gone|no worker has returned"):
            workers.run_one(square, 3, deadline=LONG)


def run_command(folder, *words):
    asked = ("run", "push", "--modules", "4", "--starts", "6", "--out", "run", *words)
    command = [sys.executable, "-m", "topo_search", *asked]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_signal_ends_a_command_that_waits_for_a_scheduler(tmp_path, listener, mute):
    process = run_command(tmp_path, "--dask", mute)
    with listener.accept()[0]:
        time.sleep(1.0)
        process.terminate()
        _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert says(told.splitlines()[-1], "stopped", "kept", "same command")
    assert "Traceback" not in told


def test_a_scheduler_that_ends_is_a_line_and_a_status(tmp_path):
    with Cluster(tmp_path) as cluster:
        cluster.add_worker()
        process = run_command(tmp_path, "--dask", cluster.address, "--starts", "1000")
        eventually(lambda: (tmp_path / "run" / "ledger.sqlite").exists())
        time.sleep(6.0)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)
        _, told = process.communicate(timeout=120)
    assert process.returncode == 70, told
    assert "is gone; finished results are safe" in told.splitlines()[-1]
    words = ("warning: ", "preparing", "modules", "the Dask scheduler")
    assert all(any(word in line for word in words) for line in told.splitlines()), told


@pytest.mark.parametrize("name", ["Python", *COMPUTING])
def test_another_version_of_anything_that_computes_is_refused(cluster, name):
    versions = computing_versions()
    here = versions[name]
    assert here == (".".join(map(str, sys.version_info[:3])) if name == "Python" else metadata.version(name))
    differ = rf"the Dask worker tcp://\S+ has {name} {here}, where this process has 0\.1: results could differ"
    with (
        DaskWorkers(cluster.address, {**versions, name: "0.1"}) as workers,
        pytest.raises(WorkersLost, match=differ),
    ):
        workers.run_one(square, 3, deadline=LONG)


def test_whatever_a_worker_loads_to_solve_and_audit_must_be_the_same():
    """What is loaded beside it is data, transport and what these load for themselves."""
    code = "import sys, topo_search.compose; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    top = set(done.stdout.split())
    modules = metadata.packages_distributions()
    loaded = {name for module in top for name in modules.get(module, ())}
    beside = {
        "Cython",
        "Pebble",
        "annotated-types",
        "lxml",  # trimesh loads it and the next one where they are installed
        "pillow",
        "cloudpickle",
        "charset-normalizer",  # numpy.f2py reads Fortran with it where it is installed
        "pydantic_core",
        "setuptools",  # its hook for distutils, loaded as Python starts
        "typing-inspection",
        "typing_extensions",
        "tomli_w",
    }
    assert loaded - set(COMPUTING) - beside == set()
