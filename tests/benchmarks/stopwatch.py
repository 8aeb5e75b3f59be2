"""How much of Ipopt's time goes into evaluating functions and derivatives; the rest is linear algebra."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca


class Stopwatch:
    """Watches every solver that CasADi makes from now on."""

    def __init__(self) -> None:
        """Begin."""
        self.evaluation = 0.0
        """CPU seconds in functions and derivatives."""
        self.ipopt = 0.0
        """CPU seconds in Ipopt, evaluation included."""
        self._nlpsol = ca.nlpsol
        ca.nlpsol = self._watched

    def reset(self) -> None:
        """Begin again."""
        self.evaluation = self.ipopt = 0.0

    def _watched(self, *args: Any, **options: Any) -> _Watched:
        return _Watched(self._nlpsol(*args, **options), self)


class _Watched:
    """A solver that adds to a stopwatch."""

    def __init__(self, solver: ca.Function, watch: Stopwatch) -> None:
        self._solver, self._watch = solver, watch

    def __call__(self, *args: Any, **options: Any) -> Any:
        began = time.process_time()
        result = self._solver(*args, **options)
        self._watch.ipopt += time.process_time() - began
        times = self._solver.stats()
        self._watch.evaluation += sum(times[name] for name in times if name.startswith("t_proc_nlp"))
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)
