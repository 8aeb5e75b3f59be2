"""The request of a run, the user's inputs beside the task, and the context that determines each row.

A design is solved with increasing margins until its audit is clear. The ladder of margins follows from the task
alone, so that rows of a run can be compared: the task's own margin, then ten times the previous one. Where
clearances must survive the tolerances the rungs are closer, and the audit selects the next one: the first that
makes up for the clearance lost under the worst errors, or the last.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib import metadata
from typing import Any, Literal, get_args

from pydantic import Field

from topo_search.engine import Candidates
from topo_search.engine.features import LatticeCandidates, ListedCandidates, TypedCandidates
from topo_search.engine.strategy import SamplerFactory
from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, ResolvedTask, Task, Value
from topo_search.model.features import Level, Stated, Versioned, fallback
from topo_search.topologies import Resolution, Symmetry, exact_group, resolve_symmetry

StrategyName = Literal["exhaustive", "randomized", "optuna"]
Sampler = Literal["moves", "tpe", "nsga2", "random"]
DEFAULT_ROUND = 8
"""Default number of open proposals: those whose results may be unknown when the next one is made."""


class UserInputs(Value):
    """The user's inputs beside the task that distinguish runs."""

    topologies: tuple[str, ...] | None = None
    """Keys of the only candidates, in ascending order; None: all trees."""
    near: tuple[str, ...] = ()
    """Digests of the designs that warm-start every candidate."""
    constraints: tuple[Stated, ...] = ()
    sampler: Versioned | None = None

    @property
    def unversioned(self) -> tuple[str, ...]:
        """Names of functions without a version: changes of them go unnoticed."""
        functions = (*self.constraints, *([] if self.sampler is None else [self.sampler]))
        return tuple(function.name for function in functions if function.version is None)

    @property
    def context_fields(self) -> dict[str, Any]:
        """The inputs that affect the result of a candidate."""
        inputs = self.model_dump(mode="json", include={"near", "constraints"})
        return {name: value for name, value in inputs.items() if value}

    def sensitive(self, *invariances: str) -> str | None:
        """Return the name of a constraint that has none of these invariances."""
        return next((x.name for x in self.constraints if x.invariant not in invariances), None)


NO_INPUTS = UserInputs()


def installed_versions() -> dict[str, str]:
    """Return the installed versions of the distributions that can change a result."""
    libraries = ("topo-search", "casadi", "numpy", "python-fcl", "scipy")
    return {name: metadata.version(name) for name in libraries}


def digest(value: Any) -> str:
    """Return a short digest of a JSON value."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Context:
    """Everything that determines a row except its topology; rows of one context can be compared."""

    task: ResolvedTask
    step: int
    """Index among the task's `margins`: 0 for its own; larger ones follow an audit that was not clear."""
    seed: int
    versions: dict[str, str]
    """Versions of the libraries."""
    level: Level | None = None
    """Level of the goals, if the run has any: its warm starts differ from those of other levels."""
    user_inputs: UserInputs = NO_INPUTS
    """The user's inputs beside the task."""

    @cached_property
    def fixed_by(self) -> dict[str, Any]:
        """The JSON value of which the name is a digest."""
        level = {} if self.level is None else {"level": self.level._asdict()}
        fixed_by = {"task": self.task.model_dump(mode="json"), "seed": self.seed, "versions": self.versions}
        return {**fixed_by, **level, **self.user_inputs.context_fields}

    @cached_property
    def name(self) -> str:
        """Digest that is part of the key of its rows, beside the topology's key."""
        return digest(self.fixed_by)

    @property
    def margin(self) -> float:
        """The solver's margin [m]."""
        return self.task.search.margin


class Identity(Value):
    """The identity of a folder's only run. More starts and more trials extend a run, so they are not part of it."""

    task: str
    """Digest of the task."""
    seed: int
    symmetry: Symmetry
    strategy: StrategyName
    prune: bool | None = None
    """Whether an exhaustive search prunes; None for other strategies."""
    sampler: Sampler | None = None
    """Sampler of a search that is not exhaustive, unless the user provides it."""
    round_size: int = Field(DEFAULT_ROUND, ge=1, le=LIMITS.round)
    """Number of open proposals of a search that is not exhaustive."""
    proposals: Literal["by whole rounds", "ahead of results"] = "by whole rounds"
    """Order of proposals of such a search. Older folders have whole rounds, each waiting for its last job."""
    own: UserInputs | None = None
    """The user's inputs beside the task, if any."""


@dataclass(frozen=True)
class Request:
    """What a run must find, and how it searches. Resources (workers, time) are not part of it."""

    task: Task
    symmetry: Symmetry
    """Symmetry under which trees are merged into one candidate."""
    starts: int
    """Largest number of starts of each candidate."""
    seed: int
    strategy: StrategyName = "exhaustive"
    """How candidates are selected."""
    sampler: Sampler = "moves"
    """What proposes candidates with the strategy `optuna`."""
    trials: int | None = None
    """Number of candidates to propose; None: all."""
    prune: bool = False
    """True if candidates are skipped that the bound proves to be no better than the best."""
    round_size: int = DEFAULT_ROUND
    """Number of open proposals. The index of a proposal alone determines which results it has."""
    versions: dict[str, str] = field(default_factory=installed_versions)
    """Versions of the libraries that solve; rows of other versions do not count."""
    asked: Request | None = None
    """The request with the defaults of flying tasks that this one does without, as no design holds them."""
    level: Level | None = None
    """The level of the goals that `task` has, in a run with goals."""
    previous: Request | None = None
    """Request of the previous level, whose designs are warm starts."""
    user_inputs: UserInputs = NO_INPUTS
    """The user's inputs beside the task, as the folder stores them."""
    near: tuple[Design, ...] = field(default=(), compare=False)
    """Designs that warm-start every candidate; not needed to read a folder."""
    sampler_factory: SamplerFactory | None = field(default=None, compare=False)
    """Makes the user's sampler; not needed to read a folder."""

    def __post_init__(self) -> None:
        """Check the fields; ValueError names the first invalid one."""
        for name, number, maximum in (
            ("starts", self.starts, LIMITS.starts),
            ("trials", self.trials, LIMITS.trials),
            ("round_size", self.round_size, LIMITS.round),
        ):
            if number is not None and not 1 <= number <= maximum:
                raise ValueError(f"`1 <= {name} <= {maximum:,}` must hold, but got {number:,}")
        for name, value, choices in (
            ("strategy", self.strategy, get_args(StrategyName)),
            ("sampler", self.sampler, get_args(Sampler)),
        ):
            if value not in choices:
                raise ValueError(f"{name} must be one of {', '.join(choices)}, but got {value!r}")
        if self.user_inputs.topologies is not None and self.strategy == "optuna":
            raise ValueError("`topologies` requires another strategy, such as `exhaustive`: all are solved")
        if self.task.search.lattice is not None and self.strategy == "optuna":
            raise ValueError("`search.lattice` requires another strategy than `optuna`, whose samplers know trees")
        if self.strategy == "randomized" and self.task.search.maximize is None:
            raise ValueError("the strategy `randomized` requires `search.maximize`")
        if self.prune and self.task.search.maximize is not None:
            raise ValueError("`prune` cannot be combined with `search.maximize`: it compares efforts")
        if self.user_inputs.sampler is not None and self.strategy != "optuna":
            raise ValueError("a sampler of your own requires the strategy `optuna`")

    @cached_property
    def identity(self) -> Identity:
        """The identity of the run."""
        tasks = [self.task.resolve(n).model_dump(mode="json") for n in self.task.sizes]
        if self.task.goals.names:
            tasks.append(self.task.goals.model_dump(mode="json"))
        sampled = self.strategy == "optuna"
        return Identity(
            task=digest(tasks),
            seed=self.seed,
            symmetry=self.symmetry,
            strategy=self.strategy,
            prune=self.prune if self.strategy == "exhaustive" else None,
            sampler=self.sampler if sampled and self.user_inputs.sampler is None else None,
            own=None if self.user_inputs == NO_INPUTS else self.user_inputs,
            round_size=self.round_size if sampled else DEFAULT_ROUND,
            proposals="ahead of results" if sampled else "by whole rounds",
        )

    @property
    def fallback(self) -> Request:
        """The request that follows if no design holds the defaults of flying tasks."""
        task = fallback(self.task)
        strategy = "randomized" if self.strategy == "exhaustive" and task.search.maximize else self.strategy
        return replace(self, task=task, asked=self, strategy=strategy, prune=False)

    @property
    def folder_name(self) -> str:
        """The name of the default folder, NAME-HASH."""
        identity = self.identity.model_dump(exclude_defaults=True)
        return f"{self.task.name}-{digest({**identity, 'starts': self.starts})[:8]}"

    @cached_property
    def levels(self) -> tuple[Request, ...]:
        """A request for each level of the task's goals, in the order of `Goals.levels`; without goals, itself."""
        goals, requests = self.task.goals, list[Request]()
        if not goals.names:
            return (self,)
        for number, level in enumerate(goals.levels):
            index = goals.level_before(number)
            previous = None if index is None else requests[index]
            requests.append(replace(self, task=self.task.at(level), level=level, previous=previous))
        return tuple(requests)

    def space(self, n: int) -> Candidates:
        """Return the candidates of n modules."""
        return self._candidates_of(n)[0]

    def quotient(self, n: int) -> Resolution:
        """Return which trees are merged into one candidate, whether that is exact, and why."""
        return self._candidates_of(n)[1]

    @cached_property
    def _candidates_of(self) -> Callable[[int], tuple[Candidates, Resolution]]:
        return cache(self._resolve_candidates)

    def _resolve_candidates(self, n: int) -> tuple[Candidates, Resolution]:
        task, inputs = self.task.resolve(n), self.user_inputs
        if inputs.topologies is not None:
            keys = [key for key in inputs.topologies if len(key.partition("-")[0]) - 1 == n]
            return ListedCandidates(task, keys), Resolution("c1", True, "every listed topology is a candidate")
        by_number, by_mirror = inputs.sensitive("numbering", "mirror"), inputs.sensitive("mirror")
        flat = task.search.lattice is not None
        space = LatticeCandidates if flat else TypedCandidates if task.module_types else Candidates
        free = not task.search.root_ranges
        if self.symmetry == "task" and by_number is not None and not flat:
            reason = f"every rooted tree is a candidate: {by_number!r} may depend on module numbers"
            return space(task, "none", rooted=True), Resolution("c1", True, reason)
        rotations_only = free and self.symmetry == "task" and by_mirror is not None and exact_group(task) != "c1"
        symmetry: Symmetry = "c2" if rotations_only else self.symmetry
        resolution = resolve_symmetry(task, symmetry)
        violator = by_number if free or flat else None
        if violator is None and resolution.group in ("d2", "d4"):
            violator = by_mirror
        if rotations_only:
            reason = f"{resolution.reason}; {by_mirror!r} may distinguish mirror images"
            resolution = replace(resolution, reason=reason)
        elif violator is not None and resolution.exact:
            reason = f"lossy: {violator!r} may distinguish trees that are merged"
            resolution = Resolution(resolution.group, False, reason)
        return space(task, symmetry), resolution

    def covers(self, n: int) -> bool:
        """True if the candidates represent every tree of n modules that the task's connectors and root allow.

        Only then does a proof for all candidates hold for the size; statements about a size depend on this.
        """
        if self.user_inputs.topologies is None:
            return self.quotient(n).exact
        all_trees = replace(
            self, user_inputs=self.user_inputs.model_copy(update={"topologies": None}), symmetry="task"
        ).space(n)
        listed, total = self.space(n), all_trees.count()
        if listed.count() < total:
            return False
        return len({all_trees.key_of(candidate.topology) for candidate in listed.candidates()}) == total

    @cached_property
    def contexts(self) -> Callable[[int], list[Context]]:
        """Returns the contexts of n modules: the task's own margin, then each larger one."""

        @cache
        def contexts(n: int) -> list[Context]:
            fixed, task = (self.seed, self.versions, self.level, self.user_inputs), self.task.resolve(n)
            return [Context(with_margin(task, margin), k, *fixed) for k, margin in enumerate(margins(task))]

        return contexts


LARGER_MARGINS = 3
"""Attempts to repair a design that fails its audit, each with a larger margin."""


def margins(task: ResolvedTask) -> list[float]:
    """Return the ladder of margins of a task [m], its own first, in ascending order."""
    ladder = [task.search.margin]
    if not task.flight.tolerances:
        for _ in range(LARGER_MARGINS):
            ladder.append(10.0 * ladder[-1] or 1.0e-4)
        return ladder
    errors, module, n = task.tolerances, task.module, task.n
    delta, shift = math.radians(errors.hinge_angle_deg), 2 * errors.position + 2 * errors.envelope
    # the worst case, a stretched-out platform: each hinge moves the far end of the airflow by delta times this
    longest_lever = 2 * n * (task.longest_connector + module.arm_length) + max(kind.reach for kind in task.types)
    smallest = max(ladder[0], delta * module.arm_length + shift / 4)
    largest = 2 * (shift + delta * n * longest_lever)
    ratio = 1.25  # of one margin to the previous one
    steps = max(LARGER_MARGINS, math.ceil(math.log(largest / smallest, ratio)))
    return ladder + [smallest * ratio**k for k in range(1, steps + 1)]


def with_margin(task: ResolvedTask, margin: float) -> ResolvedTask:
    """Return the task with another margin [m]; of a larger one, module centres keep no more than errors take."""
    changed: dict[str, float] = {"margin": margin}
    if task.flight.tolerances and margin > task.search.margin:
        changed["centre_margin"] = task.search.least_margin
    return task.model_copy(update={"search": task.search.model_copy(update=changed)})


def _is_beyond_margins(audit: Audit) -> bool:
    """True if a bracket is not clear of a module that it joins: the solver leaves brackets out."""
    parents = {joint.child: joint.module for joint in audit.assembly.joints}
    brackets = (pair for pair in audit.pairs if pair.kind in ("bracket-airflow", "bracket-rotor"))
    return any(p.status != "clear" and p.b in (p.a, parents.get(p.a)) for p in brackets)


@dataclass
class Margins:
    """The margins of one design: raised until its audit is clear, at most `LARGER_MARGINS` times."""

    tasks: Sequence[ResolvedTask]
    """The task with each of its `margins`."""
    step: int = 0
    """Index of the current margin."""
    _raised: int = 0

    @classmethod
    def of(cls, task: ResolvedTask) -> Margins:
        """Return the margins of a task, its own first."""
        return cls([with_margin(task, margin) for margin in margins(task)])

    @property
    def task(self) -> ResolvedTask:
        """The task with the current margin."""
        return self.tasks[self.step]

    def raise_after(self, audit: Audit) -> bool:
        """Raise the margin as an audit requires; return False if none can help or no attempt remains."""
        if _is_beyond_margins(audit):
            return False
        step = self._next_step(audit)
        if step == len(self.tasks) or self._raised == LARGER_MARGINS:
            return False
        self.step, self._raised = step, self._raised + 1
        return True

    def _next_step(self, audit: Audit) -> int:
        """Return the step after an audit that was not clear; `len(tasks)` if no margin is large enough."""
        next_step, last = self.step + 1, len(self.tasks) - 1
        worst = None if audit.sensitivity is None else audit.sensitivity.tolerances
        if not self.task.flight.tolerances or worst is None:
            return next_step
        key = (worst.kind, worst.a, worst.b, worst.segment)
        nominal = (pair.analytic_m for pair in audit.pairs if (pair.kind, pair.a, pair.b, pair.segment) == key)
        required = next(nominal, self.task.search.margin) - worst.lower_m  # what the errors take from this pair
        sufficient = (k for k in range(next_step, last) if self.tasks[k].search.margin >= required)
        return next(sufficient, max(next_step, last))
