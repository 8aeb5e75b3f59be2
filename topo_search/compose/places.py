"""Places where jobs run: processes on this machine, or the workers of a Dask scheduler."""

from __future__ import annotations

import os
from collections.abc import Mapping

from topo_search.engine import CallingProcess, Certificates, DaskWorkers, Workers, computing_versions
from topo_search.limits import WORKERS
from topo_search.model import BadInput, Fault
from topo_search.study import Observer


def open_engine(
    workers: int | None,
    dask: str | None,
    certificates: Certificates | None,
    versions: Mapping[str, str],
    observer: Observer,
) -> Workers | DaskWorkers:
    """Return the workers; those of a scheduler must have the same versions of the libraries."""
    if dask is None:
        if certificates is not None:
            raise BadInput("dask_tls", [Fault("", "certificates need the address of a Dask scheduler, in dask")])
        return Workers(workers or available_cores())
    if workers is not None:
        raise BadInput("workers", [Fault("", "cannot be chosen with dask: all workers of the scheduler are used")])
    same = {**computing_versions(), **versions}
    return DaskWorkers(dask, same, note=observer.note, certificates=certificates)


def processes(workers: int) -> Workers | CallingProcess:
    """Return so many worker processes; 0: the calling process, which then crashes or hangs with a job."""
    return Workers(workers) if workers else CallingProcess()


def available_cores() -> int:
    """Return the number of cores that this process may use, at most the largest number of workers."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, WORKERS)
