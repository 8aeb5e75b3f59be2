"""An engine that runs jobs on the workers of a Dask cluster.

Each thread of a Dask worker passes its jobs to a child process of `Workers`, so that a crash or a hang costs one
job. Jobs and results pass through the Dask worker as bytes; only the child loads the solver. Timeouts and
certificates of connections are those of Dask's own configuration.
"""

from __future__ import annotations

import math
import os
import pickle
import re
import threading
import time
from typing import TYPE_CHECKING, Any

from topo_search.engine.workers import (
    Call,
    Deadline,
    Engine,
    Failed,
    Item,
    Jobs,
    Note,
    Preparation,
    Result,
    Results,
    Workers,
    WorkersLost,
)
from topo_search.model import BadInput
from topo_search.process import call_pickled, tell

if TYPE_CHECKING:
    from distributed import Client, Future

PREPARATION_S = 600.0
"""Time after which compiling on a Dask worker counts as hung [s]."""
_thread = threading.local()
"""The `child` of each thread of a Dask worker, which ends with the Dask worker."""


def run_in_child(call: bytes, deadline: float, seconds: float) -> bytes | Failed:
    """Run a pickled function with its job (in a Dask worker).

    Args:
        call: the function and the job.
        deadline: time after which the job counts as hung [s].
        seconds: time after which nobody waits for its result [s].
    """
    if not hasattr(_thread, "child"):
        # Dask lets the C library return free memory at once; solvers need it again, and would take a sixth longer
        os.environ.pop("MALLOC_TRIM_THRESHOLD_", None)
        _thread.child = Workers(1)
    child: Workers = _thread.child
    for _, result in child.run(call_pickled, [call], deadline=lambda _: deadline, until=time.monotonic() + seconds):
        return result
    return Failed("timeout", "time limit reached")


def _prepare(call: tuple[Preparation[Item], Item]) -> None:
    function, task = call
    function(task, tell)


class DaskWorkers(Engine):
    """Runs jobs on the workers of a Dask scheduler, which may join and leave; connects with the first job.

    If a Dask worker ends, Dask sends its jobs to another one.
    """

    def __init__(self, address: str, *, note: Note = lambda _: None) -> None:
        """Set up the engine.

        Args:
            address: address of the scheduler, such as tcp://10.0.0.1:8786.
            note: receives messages while the user waits.

        Raises:
            BadInput: the address is invalid.
        """
        if re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", address) is None:
            rule = f"must be the address of a Dask scheduler, tcp://HOST:PORT, but got {address!r}"
            raise BadInput("dask", rule)
        self.address = address
        self._note = note
        self._client: Client | None = None

    def stop(self) -> None:
        """Disconnect from the scheduler."""
        if self._client is not None:
            self._client.close(timeout=1.0)

    def prepare(self, function: Preparation[Item], task: Item, note: Note) -> None:
        """Compile on the current Dask workers, before the first job; messages go to the workers' logs.

        A worker that joins later compiles with its first job.
        """
        note("preparing the Dask workers")
        for _ in self.run(_prepare, [(function, task)] * self._threads(), deadline=lambda _: PREPARATION_S):
            pass

    def run(
        self, function: Call[Item, Result], jobs: Jobs[Item], *, deadline: Deadline[Item], until: float = math.inf
    ) -> Results[Item, Result]:
        """Yield (job, result) as jobs end; at most two jobs per thread of the Dask workers are drawn in advance."""
        from distributed import as_completed

        pending, running = iter(jobs), dict["Future[bytes | Failed]", Item]()
        completed: as_completed | None = None
        while (seconds := until - time.monotonic()) > 0.0:
            while (not running or len(running) < 2 * self._threads()) and (job := next(pending, None)) is not None:
                if completed is None:
                    completed = as_completed(
                        loop=self._connect().loop, timeout=None if math.isinf(seconds) else seconds
                    )
                call = pickle.dumps((function, job))
                future = self._connect().submit(run_in_child, call, deadline(job), seconds, pure=False)
                running[future] = job
                completed.add(future)
            if completed is None or not running:
                return
            try:
                future = next(completed)
            except TimeoutError:
                return
            yield running.pop(future), self._result(future)

    def _connect(self) -> Client:
        """Return the client; the first call connects it."""
        if self._client is None:
            from distributed import Client

            try:
                self._client = Client(self.address, set_as_default=False)
            except (OSError, TypeError, ValueError) as error:  # the latter two without certificates
                raise WorkersLost(f"no Dask scheduler answers at {self.address}: {error}") from None
            if not self._threads():
                self._note(f"the Dask scheduler at {self.address} has no workers; waiting for the first one")
        return self._client

    def _threads(self) -> int:
        """Return the number of jobs that all Dask workers run at a time."""
        try:
            return sum(self._connect().nthreads().values())
        except OSError:
            raise self._loss() from None

    def _result(self, future: Future[bytes | Failed]) -> Any:
        """Return the result of a job; Failed if it ended its Dask workers."""
        from distributed import KilledWorker

        if future.cancelled():
            raise self._loss()
        error = future.exception()
        if isinstance(error, KilledWorker):
            times = error.allowed_failures + 1
            return Failed("crash", f"the Dask worker that ran it ended, {times} times in a row")
        if error is not None:
            fault = error if isinstance(error, WorkersLost) else f"{type(error).__name__}: {error}"
            raise WorkersLost(f"the Dask cluster at {self.address} cannot run jobs: {fault}")
        result = future.result()
        return result if isinstance(result, Failed) else pickle.loads(result)

    def _loss(self) -> WorkersLost:
        return WorkersLost(f"the Dask scheduler at {self.address} is gone")
