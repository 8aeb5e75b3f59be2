"""User input beside a task, checked and put into the form that a run takes."""

from __future__ import annotations

import pickle
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import get_args

import cloudpickle

from topo_search.limits import NEAR, OWN_CONSTRAINTS
from topo_search.model import BadInput, Design, Fault, Task
from topo_search.protocols import (
    ConstraintExpression,
    Expression,
    OwnConstraint,
    OwnSampler,
    SamplerFactory,
    SymbolicPlatform,
    TopologySampler,
)
from topo_search.study import Own, Sampler
from topo_search.study.request import digest
from topo_search.topologies import OwnTopology, own_candidates

AnySampler = Sampler | OwnSampler | SamplerFactory | TopologySampler
"""Samplers that `search` takes."""


@dataclass(frozen=True)
class Handed:
    """Input that a user gave a search."""

    own: Own
    """As far as the run's folder keeps it."""
    near: tuple[Design, ...]
    sampler: Sampler
    """The one that a name stands for."""
    propose: SamplerFactory | None
    """Factory of the user's own."""
    constraints: tuple[OwnConstraint, ...]


def collect_own(
    task: Task,
    *,
    near: Iterable[Design],
    constraints: Iterable[OwnConstraint],
    topologies: Iterable[OwnTopology] | None,
    sampler: AnySampler,
    elsewhere: bool,
) -> Handed:
    """Return what a user handed in; arguments as of `search`.

    Raises:
        BadInput: something cannot be used; names it.
        ValueError: an unknown sampler.
    """
    designs, own_sampler = starting_points(near), _own_sampler(sampler)
    stated = own_constraints(constraints, elsewhere=elsewhere)
    return Handed(
        Own(
            topologies=None if topologies is None else own_candidates(topologies, task),
            near=tuple(digest(design.model_dump(mode="json", exclude={"solver"})) for design in designs),
            constraints=tuple(one.stated for one in stated),
            sampler=None if own_sampler is None else own_sampler.stated,
        ),
        designs,
        sampler if isinstance(sampler, str) else "moves",
        None if own_sampler is None else own_sampler.make,
        stated,
    )


def starting_points(near: Iterable[Design]) -> tuple[Design, ...]:
    """Return designs to start from; BadInput if they are none, or too many."""
    if isinstance(near, Design | str) or not isinstance(near, Iterable):
        raise BadInput("near", f"must be a list of designs, but got {_one(near)}")
    designs = tuple(near)
    faults = [
        Fault(f"[{k}]", f"must be a Design, but got {type(design).__name__}")
        for k, design in enumerate(designs)
        if not isinstance(design, Design)
    ]
    if len(designs) > NEAR:
        faults = [Fault("", f"must be at most {NEAR:,} designs, but got {len(designs):,}")]
    if faults:
        raise BadInput("near", faults)
    return designs


def own_constraints(constraints: Iterable[OwnConstraint], *, elsewhere: bool = False) -> tuple[OwnConstraint, ...]:
    """Return own constraints as they can be sent to workers.

    Args:
        constraints: to be sent to other processes.
        elsewhere: whether these are on other machines.

    Raises:
        BadInput: two have one name, one is no constraint or cannot be sent, or there are too many.
    """
    if isinstance(constraints, str) or not isinstance(constraints, Iterable):
        raise BadInput("constraints", f"must be a list of OwnConstraint, but got {_one(constraints)}")
    given = tuple(_sendable(one, elsewhere=elsewhere) for one in islice(constraints, OWN_CONSTRAINTS + 1))
    if len(given) > OWN_CONSTRAINTS:
        raise BadInput("constraints", f"must be at most {OWN_CONSTRAINTS:,}, but got more")
    faults = list[Fault]()
    for k, one in enumerate(given):
        if not isinstance(one, OwnConstraint):
            faults.append(Fault(f"[{k}]", f"must be an OwnConstraint, but got {type(one).__name__}"))
        elif (reason := _reason_to_stay(one, elsewhere=elsewhere)) is not None:
            faults.append(Fault(one.name, reason))
    if not faults:
        names = Counter(one.name for one in given)
        faults = [Fault(name, "must be the name of one constraint") for name, times in names.items() if times > 1]
    if faults:
        raise BadInput("constraints", faults)
    return given


def _one(given: object) -> str:
    """Return what to say of a single thing where a list is asked for."""
    kind = type(given).__name__
    return f"one {kind}: write it in brackets" if isinstance(given, Design | OwnConstraint) else kind


@dataclass(frozen=True)
class ByValue:
    """An expression of a notebook, a prompt or inside a function, which no other process can import."""

    content: bytes
    """It and all that it refers to there, pickled."""

    def __call__(self, platform: SymbolicPlatform, /) -> Expression:
        """Return what it returns."""
        return _expression(self.content)(platform)


@cache
def _expression(content: bytes) -> ConstraintExpression:
    expression: ConstraintExpression = pickle.loads(content)
    return expression


def _sendable(one: OwnConstraint, *, elsewhere: bool) -> OwnConstraint:
    """Return a constraint with its expression by value if workers cannot import it, and that is possible."""
    if not isinstance(one, OwnConstraint) or _reason_to_stay(one, elsewhere=elsewhere) is None:
        return one
    try:
        return replace(one, expression=ByValue(cloudpickle.dumps(one.expression)))
    except (TypeError, pickle.PicklingError):  # it refers to a file, a lock, ...: refused with the reason
        return one


def _reason_to_stay(constraint: OwnConstraint, *, elsewhere: bool) -> str | None:
    """Return why a constraint cannot be sent to workers; None if it can."""
    if isinstance(constraint.expression, ByValue):
        return None
    how = "write it as a function at the top of a module, with `functools.partial` for its numbers"
    try:
        sent = pickle.dumps(constraint)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        return f"cannot be sent to worker processes ({error}); {how}"
    if b"__main__" not in sent:
        return None
    if elsewhere:
        return f"is defined in a script, which Dask workers cannot import; {how} that they have"
    main = sys.modules["__main__"]
    if getattr(main, "__spec__", None) is None and not Path(getattr(main, "__file__", None) or "").is_file():
        return f"is defined in a notebook or a prompt, which worker processes cannot import; {how}"
    return None


def _own_sampler(sampler: AnySampler) -> OwnSampler | None:
    """Return a user's own sampler with a name; None for one of ours."""
    if isinstance(sampler, str):
        return None
    if isinstance(sampler, OwnSampler):
        return sampler
    if callable(sampler):
        return OwnSampler(getattr(sampler, "__qualname__", type(sampler).__name__), sampler)
    if isinstance(sampler, TopologySampler):
        return OwnSampler(type(sampler).__name__, _Always(sampler))
    known = ", ".join(get_args(Sampler))
    rule = f"must be {known}, or make one for a seed, such as `lambda seed: {type(sampler).__name__}(seed=seed)`"
    raise ValueError(f"sampler {rule}, but got {sampler!r}")


@dataclass(frozen=True)
class _Always:
    """Makes the same sampler for every seed: one without a state."""

    sampler: TopologySampler

    def __call__(self, seed: int, /) -> TopologySampler:
        """Return it."""
        return self.sampler
