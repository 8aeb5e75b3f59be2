"""Share of Ipopt's time for functions and derivatives; the rest is linear algebra."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca


class Stopwatch:
    """Times every solver that CasADi makes from now on."""

    def __init__(self) -> None:
        """Start timing."""
        self.evaluation = 0.0
        """CPU time in functions and derivatives [s]."""
        self.ipopt = 0.0
        """CPU time in Ipopt, evaluation included [s]."""
        self._nlpsol = ca.nlpsol
        ca.nlpsol = self._timed_nlpsol

    def reset(self) -> None:
        """Set all times to zero."""
        self.evaluation = self.ipopt = 0.0

    def _timed_nlpsol(self, *args: Any, **options: Any) -> _TimedSolver:
        return _TimedSolver(self._nlpsol(*args, **options), self)


class _TimedSolver:
    """A solver that adds its times to a stopwatch."""

    def __init__(self, solver: ca.Function, watch: Stopwatch) -> None:
        self._solver, self._watch = solver, watch

    def __call__(self, *args: Any, **options: Any) -> Any:
        started = time.process_time()
        result = self._solver(*args, **options)
        self._watch.ipopt += time.process_time() - started
        times = self._solver.stats()
        self._watch.evaluation += sum(times[name] for name in times if name.startswith("t_proc_nlp"))
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)
