"""What runs in a Dask worker: it hands jobs one by one to a child, so that a crash or a hang costs one job.

The child is that of `Workers`, on one machine or on many. Jobs and results pass through the Dask worker as bytes:
only the child loads what solves.
"""

from __future__ import annotations

import os
import pickle
import platform
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from multiprocessing import current_process

from topo_search.engine.backends import Failed
from topo_search.engine.jobs import WorkersLost
from topo_search.engine.workers import Workers

BATCH = 2.0
"""How long a batch of jobs should take [s]: long beside the moment in which a child waits for the next one."""

COMPUTING = (
    "topo-search",
    "casadi",
    "llvmlite",
    "networkx",
    "numba",
    "numpy",
    "pydantic",
    "python-fcl",
    "scipy",
    "trimesh",
)
"""Distributions that a job computes with, from the task to the audit; Python counts with them."""
PYTHON = "Python"
"""The name of its version among theirs."""

TRIM = "MALLOC_TRIM_THRESHOLD_"
"""Dask sets it for its workers, which may hold much data: the C library then gives memory back to the system as
soon as it is free. A solver needs it again at once, and takes a sixth longer: children do without."""


@dataclass(frozen=True)
class Batch:
    """Jobs that are sent together."""

    calls: tuple[bytes, ...]
    """A function and its job each, pickled."""
    deadlines: tuple[float, ...]
    """Seconds that each may take."""
    seconds: float
    """After which what has not ended is dropped."""
    versions: dict[str, str]
    """Of the distributions that can change a result."""


@dataclass(frozen=True)
class Ended:
    """What comes back of a batch."""

    results: tuple[tuple[int, bytes | Failed], ...]
    """The place in the batch, and the pickled result, of each job that was begun and not dropped."""
    seconds: float
    """What they took together."""


_thread = threading.local()
"""Keeps, for each thread of a Dask worker, which runs one task at a time, a child that ends with the Dask worker,
and the versions that it was found to have: they must not be changed under it."""


def run_guarded(batch: Batch) -> Ended:
    """Run the jobs of a batch that can be begun in its time (in a Dask worker).

    Raises:
        WorkersLost: this Dask worker can run no job, or none whose result could be reproduced.
    """
    if getattr(_thread, "versions", None) != batch.versions:  # to look them up takes as long as many a job
        if fault := find_fault(batch.versions)():
            raise WorkersLost(f"the Dask worker {current_process().name} {fault}")
        _thread.versions = batch.versions
    if not hasattr(_thread, "child"):
        os.environ.pop(TRIM, None)
        _thread.child = Workers(1).__enter__()
    child: Workers = _thread.child
    begun = time.monotonic()

    def calls() -> Iterator[tuple[int, bytes]]:
        """Yield calls with their places. Slow jobs after quick ones may be many: who is idle shall have them."""
        for place, call in enumerate(batch.calls):
            if place == 0 or time.monotonic() - begun < BATCH:
                yield place, call

    ended = child.run(
        _call,
        calls(),
        deadline=lambda call: batch.deadlines[call[0]],
        until=begun + batch.seconds,
    )
    results: list[tuple[int, bytes | Failed]] = []
    for (place, _), result in ended:
        if isinstance(result, WorkersLost):
            raise result
        results.append((place, result))
    return Ended(tuple(results), time.monotonic() - begun)


def _call(call: tuple[int, bytes]) -> bytes | WorkersLost:
    """Call a function with its job (in the child); what cannot be loaded here is no fault of the job."""
    try:
        function, job = pickle.loads(call[1])
    except (AttributeError, ImportError) as error:
        return WorkersLost(f"Dask workers cannot import what they must run: {error}")
    return pickle.dumps(function(job))


def computing_versions() -> dict[str, str]:
    """Return the versions that every Dask worker must have: those of what computes here."""
    return {PYTHON: platform.python_version(), **{name: metadata.version(name) for name in COMPUTING}}


def find_fault(versions: Mapping[str, str]) -> Callable[[], str | None]:
    """Return a function that says what keeps a Dask worker from being used, if anything does.

    It is sent by value and needs only Python's own library, for the worker may lack this package.

    Args:
        versions: that it must have, of the distributions that can change a result, and of Python.
    """

    def fault() -> str | None:
        import platform
        from importlib import metadata
        from multiprocessing import current_process

        if current_process().daemon:
            setting = "DASK_DISTRIBUTED__WORKER__DAEMON=False"
            return f"cannot start a child process for its jobs: set {setting} in the environment of Dask workers"
        for name, version in versions.items():
            try:
                found = platform.python_version() if name == "Python" else metadata.version(name)
            except metadata.PackageNotFoundError:
                return f"lacks {name}: it needs version {version}, as installed here"
            if found != version:
                return f"has {name} {found}, where this process has {version}: results could differ"
        return None

    return fault
