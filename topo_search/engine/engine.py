"""Where jobs run: what the search asks of worker processes, on one machine or on many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

from topo_search.engine.backends import Failed

J = TypeVar("J")
R = TypeVar("R")


class WorkersLost(RuntimeError):
    """There is no worker: none lives long enough to take a job, or nobody answers where they should be."""


class Engine(Protocol):
    """Runs pure functions elsewhere; which engine it is, and how fast, changes nothing in what they return."""

    def run(
        self,
        function: Callable[[J], R],
        jobs: Iterable[J | None],
        *,
        deadline: Callable[[J], float],
        until: float = math.inf,
    ) -> Iterator[tuple[J, R | Failed]]:
        """Yield (job, result) as jobs end, in any order; `jobs` is drawn from only seconds ahead of the workers.

        A job that crashes its process or passes its deadline is tried twice, then comes back as Failed.

        Args:
            function: importable and pure.
            jobs: picklable values, drawn lazily; None where there is none before another result was yielded.
            deadline: seconds that a job may take.
            until: time.monotonic() at which to stop: what runs then is dropped and no more is begun.

        Raises:
            WorkersLost: there is nobody to take a job.
        """
        ...

    def one(self, function: Callable[[J], R], job: J, *, deadline: float, until: float = math.inf) -> R | Failed:
        """Return the result of a single job."""
        for _, result in self.run(function, [job], deadline=lambda _: deadline, until=until):
            return result
        return Failed("timeout", "time limit reached")
