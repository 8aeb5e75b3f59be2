"""Features of a run beside search and audit.

The core imports this list and, but for those that its contract in pyproject.toml lets through, no feature.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from topo_search.engine import Strategy
from topo_search.engine.randomized import RandomizedSearch
from topo_search.engine.strategy import ExhaustiveSearch
from topo_search.study.folder import RunFolder
from topo_search.study.pareto import add_front, write_front
from topo_search.study.proofs import add_proofs
from topo_search.study.relaxing import add_causes, find_causes
from topo_search.study.solving import Tools
from topo_search.study.tables import write_candidates
from topo_search.study.time_left import remaining_plan as remaining_plan

if TYPE_CHECKING:
    from topo_search.study.answer import Answer, SizeAnswer


def exhaustive_search(folder: RunFolder, n: int, *, bound: float, timed: bool) -> Strategy:
    """Return the strategy that solves every candidate, until a design reaches the bound."""
    request = folder.request
    return ExhaustiveSearch(request.space(n), starts=request.starts, timed=timed, bound=bound)


def sampled_search(folder: RunFolder, n: int, *, bound: float, timed: bool) -> Strategy:
    """Return the strategy that solves what a sampler proposes; it ignores the bound."""
    from topo_search.engine.proposals import OptunaSearch  # loads Optuna

    request, space = folder.request, folder.request.space(n)
    return OptunaSearch(
        space,
        sampler=request.sampler_factory or request.sampler,
        trials=space.count() if request.trials is None else request.trials,
        round_size=request.round_size,
        starts=request.starts,
        seed=request.seed,
        journal=folder.journal(f"study-n{n}{'-on-paper' * (request.asked is not None)}.journal"),
        timed=timed,
    )


def randomized_search(folder: RunFolder, n: int, *, bound: float, timed: bool) -> Strategy:
    """Return the strategy that asks every candidate for more than the best value so far."""
    request = folder.request
    return RandomizedSearch(request.space(n), starts=request.starts, seed=request.seed)


STRATEGIES = {"exhaustive": exhaustive_search, "randomized": randomized_search, "optuna": sampled_search}
"""Strategies by name, each made for a size, a bound for pruning, and a run with or without a time limit."""
AFTER_SEARCH: tuple[Callable[[RunFolder, Tools], None], ...] = (find_causes,)
"""Steps after the search of all sizes, on the folder of a run without goals, or of its loosest level."""
FILES: tuple[Callable[[RunFolder], None], ...] = (write_candidates, write_front)
"""Writers of files beside designs and audits."""
ADD_TO_SIZE: tuple[Callable[[RunFolder, SizeAnswer], SizeAnswer], ...] = (add_proofs, add_causes)
"""Additions to the answer of a size."""
ADD_TO_ANSWER: tuple[Callable[[RunFolder, Answer], Answer], ...] = (add_front,)
"""Additions to the answer of a run."""
