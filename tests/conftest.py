"""The same tests everywhere: property tests draw the same examples every time, and never fail for being slow.

A shell starts background jobs with Ctrl-C ignored, which child processes inherit: tests that send it need it back.
Linear algebra has one thread, as it has in every worker: two test processes on two cores would share the cores out
among four threads, each of which waits for the others.
"""

import os
import signal
import sys
from ctypes.util import find_library
from functools import partial
from pathlib import Path

import pytest
from dask_cluster import Cluster
from hypothesis import HealthCheck, settings

from topo_search.process import ONE_THREAD

assert "numpy" not in sys.modules  # it reads the environment as it is loaded
os.environ.update(ONE_THREAD)
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # every child would compile all sources anew
sys.dont_write_bytecode = False

from topo_search.model import Design  # noqa: E402
from topo_search.model.files import read_json, to_toml  # noqa: E402

settings.register_profile("suite", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")
signal.signal(signal.SIGINT, signal.default_int_handler)
if find_library("EGL"):  # films need no display
    os.environ.setdefault("MUJOCO_GL", "egl")


def pytest_configure(config: pytest.Config) -> None:
    """Ignore what Python says about suspicious tasks: the paper's are."""
    config.addinivalue_line("filterwarnings", "ignore::topo_search.SuspiciousTask")


@pytest.hookimpl(trylast=True)  # when those are left out that are not to run
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Compile before all else: each process begins with a part of it, and waits for no other's code."""
    count, left = getattr(config, "workerinput", {}).get("workercount", 1), len(items)
    first = [item for item in items if item.get_closest_marker("compiles")]
    others = [item for item in items if item not in first]
    items.clear()
    for k in range(count):  # xdist gives each an equal share of those that are left
        part = first[k::count]
        size = max(left // (count - k) - len(part), 0)
        items += [*part, *others[:size]]
        del others[:size]
        left -= len(part) + size


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """A Dask cluster with two workers of one thread, for tests that leave them alive."""
    with Cluster(tmp_path_factory.mktemp("cluster")) as cluster:
        cluster.add_worker("--nworkers", "2")
        yield cluster


@pytest.fixture
def benchmarks(monkeypatch):
    """The folder of the benchmarks, whose files can be imported by name."""
    folder = Path(__file__).parent / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    for path in folder.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.fixture
def in_process(monkeypatch):
    """Commands and searches run all jobs here: each worker would load solver, audit and compiled code anew."""
    from toy_problem import InProcess

    monkeypatch.setattr("topo_search.compose.binding.Workers", InProcess)


@pytest.fixture
def run_toy(tmp_path, monkeypatch):
    """`topo-search run` on the toy problem in an empty folder."""
    from commands import invoke
    from toy_problem import BACKENDS, toy_task

    monkeypatch.setattr("topo_search.compose.binding.BACKENDS", BACKENDS)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy.toml").write_text(to_toml(toy_task()))
    return partial(invoke, "run", "toy.toml")


@pytest.fixture
def log(tmp_path, monkeypatch):
    """The file that gets a line for every solve of the toy problem."""
    path = tmp_path / "log"
    path.touch()
    monkeypatch.setenv("TOY_LOG", str(path))
    return path


@pytest.fixture(scope="session")
def solved_push() -> Design:
    """The winner of push, `topo-search solve push --topology a70010`: every limit is met to the last digit."""
    return read_json(Design, Path(__file__).parent / "designs/push-a70010.json")


@pytest.fixture(scope="session")
def wall_press() -> Design:
    """A design that was asked for reserves: `tests/designs/wall-press.toml` says how it was made."""
    return read_json(Design, Path(__file__).parent / "designs/wall-press.json")
