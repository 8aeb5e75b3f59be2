"""Request of a run: the request itself, the user's own input, and what fixes the value of each row.

A design is solved with one margin after another until its audit is clear. The margins that may be asked for follow
from the task alone, so that rows of a run can be compared: its own, then each ten times the one before; where the
clearances must survive the tolerances, rungs that are closer, and an audit says which of them is needed: the first
that makes up for the clearance missing under the worst errors, or the last.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import metadata
from typing import Any, Literal, get_args

from pydantic import Field

from topo_search.engine import Candidates, Listed
from topo_search.engine.strategy import SamplerFactory
from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, ResolvedTask, Task
from topo_search.model.design import Stated, Versioned
from topo_search.model.search import Level
from topo_search.model.value import Value
from topo_search.topologies import Resolution, Symmetry, resolve_symmetry

StrategyName = Literal["exhaustive", "optuna"]
Sampler = Literal["moves", "tpe", "nsga2", "random"]
DEFAULT_ROUND = 8
"""Proposals whose results may be unknown when another is made, by default."""


class Own(Value):
    """User input of a run beside its task, as far as it distinguishes runs."""

    topologies: tuple[str, ...] | None = None
    """Keys of the only candidates, in ascending order; None: all trees."""
    near: tuple[str, ...] = ()
    """Digests of the designs that every candidate starts from."""
    constraints: tuple[Stated, ...] = ()
    sampler: Versioned | None = None

    @property
    def unversioned(self) -> tuple[str, ...]:
        """Names of functions without a version: they may have changed."""
        named = (*self.constraints, *([] if self.sampler is None else [self.sampler]))
        return tuple(one.name for one in named if one.version is None)

    @property
    def fixes(self) -> dict[str, Any]:
        """Parts of it that fix the value of a row."""
        given = self.model_dump(mode="json", include={"near", "constraints"})
        return {name: value for name, value in given.items() if value}

    @property
    def telling(self) -> str | None:
        """Name of a constraint that may tell modules apart by their numbers."""
        return next((one.name for one in self.constraints if one.invariant == "none"), None)

    @property
    def handed(self) -> str | None:
        """Name of a constraint that may tell a platform from its mirror image."""
        return next((one.name for one in self.constraints if one.invariant != "mirror"), None)


NOTHING = Own()


def installed_versions() -> dict[str, str]:
    """Return the installed versions of the distributions that can change a result."""
    libraries = ("topo-search", "casadi", "numpy", "python-fcl", "scipy")
    return {name: metadata.version(name) for name in libraries}


def digest(value: Any) -> str:
    """Return a short name of a JSON value that differs whenever the value does."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Context:
    """All that fixes a row but its topology: rows of one context can be compared."""

    task: ResolvedTask
    step: int
    """Index of the task's `margins`: 0 for its own, larger ones because an audit was not clear."""
    seed: int
    versions: dict[str, str]
    """Versions of the libraries."""
    level: Level | None = None
    """Level of the goals, if the run has any: what was solved there had other designs to start from."""
    user_inputs: Own = NOTHING
    """User input beside the task."""

    @cached_property
    def fixed_by(self) -> dict[str, Any]:
        """The content that the name is a digest of."""
        level = {} if self.level is None else {"level": self.level._asdict()}
        fixed_by = {"task": self.task.model_dump(mode="json"), "seed": self.seed, "versions": self.versions}
        return {**fixed_by, **level, **self.user_inputs.fixes}

    @cached_property
    def name(self) -> str:
        """Part of the key of its rows, beside the topology's key."""
        return digest(self.fixed_by)

    @property
    def margin(self) -> float:
        """The margin asked of the solver [m]."""
        return self.task.search.margin


class Identity(Value):
    """Identity of a folder's only run. More starts and more trials extend a run, so they are left out."""

    task: str
    """A digest."""
    seed: int
    symmetry: Symmetry
    strategy: StrategyName
    prune: bool | None = None
    """Pruning of an exhaustive search; None for any other."""
    sampler: Sampler | None = None
    """Sampler of a search that is not exhaustive."""
    round_size: int = Field(DEFAULT_ROUND, ge=1, le=LIMITS.round)
    """Proposals whose results may be unknown when any other makes one."""
    proposals: Literal["by whole rounds", "ahead of results"] = "by whole rounds"
    """Order of proposals in any other; older folders are by whole rounds, which waited for their last job."""
    own: Own | None = None
    """User input beside the task, if any."""


@dataclass(frozen=True)
class Request:
    """Request of a run: what to find. Resources (workers, time) are not part of it."""

    task: Task
    symmetry: Symmetry
    """Symmetry under which trees are one candidate."""
    starts: int
    """Number of starts of each candidate, at most."""
    seed: int
    strategy: StrategyName = "exhaustive"
    """Strategy by which candidates are chosen."""
    sampler: Sampler = "moves"
    """Sampler that proposes candidates when not all are solved."""
    trials: int | None = None
    """Number of candidates to propose; None: all."""
    prune: bool = False
    """True if candidates are skipped that the bound proves to be no better than the best."""
    round_size: int = DEFAULT_ROUND
    """Largest number of open proposals: what a proposal learns from is fixed by its place alone."""
    versions: dict[str, str] = field(default_factory=installed_versions)
    """Versions of the libraries that solve; rows that others solved do not count."""
    level: Level | None = None
    """The level of the goals that `task` holds, if this is one of those of a run with goals."""
    previous: Request | None = None
    """The level before, whose designs are carried over."""
    user_inputs: Own = NOTHING
    """User input beside the task, as the folder keeps it."""
    near: tuple[Design, ...] = field(default=(), compare=False)
    """The designs to start from themselves; a folder that is only read needs none."""
    propose: SamplerFactory | None = field(default=None, compare=False)
    """Factory of the user's own sampler; likewise."""

    def __post_init__(self) -> None:
        """Refuse what cannot be asked; ValueError names it."""
        for name, number, most in (
            ("starts", self.starts, LIMITS.starts),
            ("trials", self.trials, LIMITS.trials),
            ("round_size", self.round_size, LIMITS.round),
        ):
            if number is not None and not 1 <= number <= most:
                raise ValueError(f"`1 <= {name} <= {most:,}` must hold, but got {number:,}")
        for name, value, known in (
            ("strategy", self.strategy, get_args(StrategyName)),
            ("sampler", self.sampler, get_args(Sampler)),
        ):
            if value not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, but got {value!r}")
        if self.user_inputs.topologies is not None and self.strategy != "exhaustive":
            raise ValueError("`topologies` requires the strategy `exhaustive`: all listed trees are solved")
        if self.user_inputs.sampler is not None and self.strategy != "optuna":
            raise ValueError("a sampler of your own requires the strategy `optuna`")

    @cached_property
    def identity(self) -> Identity:
        """Identity of its folder."""
        tasks = [self.task.resolve(n).model_dump(mode="json") for n in self.task.sizes]
        if self.task.goals.names:
            tasks.append(self.task.goals.model_dump(mode="json"))
        exhaustive = self.strategy == "exhaustive"
        return Identity(
            task=digest(tasks),
            seed=self.seed,
            symmetry=self.symmetry,
            strategy=self.strategy,
            prune=self.prune if exhaustive else None,
            sampler=None if exhaustive or self.user_inputs.sampler is not None else self.sampler,
            own=None if self.user_inputs == NOTHING else self.user_inputs,
            round_size=DEFAULT_ROUND if exhaustive else self.round_size,
            proposals="by whole rounds" if exhaustive else "ahead of results",
        )

    @property
    def folder_name(self) -> str:
        """The name of the default folder, NAME-HASH."""
        identity = self.identity.model_dump(exclude_defaults=True)
        return f"{self.task.name}-{digest({**identity, 'starts': self.starts})[:8]}"

    @cached_property
    def levels(self) -> tuple[Request, ...]:
        """A request for each level of the task's goals, in the order of `Goals.levels`; without goals, this one."""
        goals, requests = self.task.goals, list[Request]()
        if not goals.names:
            return (self,)
        for number, level in enumerate(goals.levels):
            before = goals.level_before(number)
            previous = None if before is None else requests[before]
            requests.append(replace(self, task=self.task.at(level), level=level, previous=previous))
        return tuple(requests)

    def space(self, n: int) -> Candidates:
        """Return the candidates of n modules."""
        return self._choice(n)[0]

    def quotient(self, n: int) -> Resolution:
        """Return which trees stand for one candidate, whether that is exact, and why."""
        return self._choice(n)[1]

    def _choice(self, n: int) -> tuple[Candidates, Resolution]:
        task, user_inputs = self.task.resolve(n), self.user_inputs
        if user_inputs.topologies is not None:
            keys = [key for key in user_inputs.topologies if len(key) - 1 == n]
            return Listed(task, keys), Resolution("c1", True, "every topology that was given is a candidate")
        telling, handed, free = user_inputs.telling, user_inputs.handed, task.search.root == "free"
        if self.symmetry == "task" and telling is not None:
            reason = f"every rooted tree is a candidate: {telling!r} may tell modules apart"
            return Candidates(task, "none", rooted=True), Resolution("c1", True, reason)
        proper = free and self.symmetry == "task" and handed is not None
        symmetry: Symmetry = "c2" if proper else self.symmetry
        resolution = resolve_symmetry(task, symmetry)
        broken = telling if free else None
        if broken is None and resolution.group in ("d2", "d4"):
            broken = handed
        if proper:
            reason = f"{resolution.reason}; {handed!r} may tell mirror images apart"
            resolution = replace(resolution, reason=reason)
        elif broken is not None and resolution.exact:
            reason = f"lossy: {broken!r} may tell trees apart that count as one"
            resolution = Resolution(resolution.group, False, reason)
        return Candidates(task, symmetry), resolution

    def covers(self, n: int) -> bool:
        """True if the candidates stand for every tree of n modules that the task's connectors and root allow.

        Only then does what is proven of all candidates hold of the size: every sentence about a size asks this.
        """
        if self.user_inputs.topologies is None:
            return self.quotient(n).exact
        every = replace(
            self, user_inputs=self.user_inputs.model_copy(update={"topologies": None}), symmetry="task"
        ).space(n)
        listed, due = self.space(n), every.count()
        if listed.count() < due:
            return False
        return len({every.key_of(candidate.topology) for candidate in listed.candidates()}) == due

    def contexts(self, n: int) -> list[Context]:
        """Return the contexts of n modules: the task's own margin, then each larger one."""
        task = self.task.resolve(n)
        return [
            Context(with_margin(task, margin), step, self.seed, self.versions, self.level, self.user_inputs)
            for step, margin in enumerate(margins(task))
        ]


LARGER_MARGINS = 3
"""Repairs of a design that fails its audit, each with a larger margin."""


def larger_margin(margin: float) -> float:
    """Return the margin to try after one that an audit did not pass [m]."""
    return 10.0 * margin or 1.0e-4


def margins(task: ResolvedTask) -> list[float]:
    """Return the margins that designs of a task may be asked for [m], its own first, each larger than the last."""
    ladder = [task.search.margin]
    if not task.flight.tolerances:
        for _ in range(LARGER_MARGINS):
            ladder.append(larger_margin(ladder[-1]))
        return ladder
    errors, module, n = task.tolerances, task.module, task.n
    delta, shift = math.radians(errors.hinge_angle_deg), 2 * errors.position + 2 * errors.envelope
    # Of a platform stretched out: every hinge moves a far end of airflow by as much.
    farthest = 2 * n * (module.connector_distance + module.arm_length) + module.reach
    least = max(ladder[0], delta * module.arm_length + shift / 4)
    most = 2 * (shift + delta * n * farthest)
    rung = 1.25  # a margin over the one before
    steps = max(LARGER_MARGINS, math.ceil(math.log(most / least, rung)))
    return ladder + [least * rung**k for k in range(1, steps + 1)]


def with_margin(task: ResolvedTask, margin: float) -> ResolvedTask:
    """Return the same task with another margin [m]."""
    return task.model_copy(update={"search": task.search.model_copy(update={"margin": margin})})


@dataclass
class Margins:
    """The margins that one design is solved with until its audit is clear, `LARGER_MARGINS` larger ones at most.

    What becomes of a design depends on itself alone.
    """

    tasks: Sequence[ResolvedTask]
    """The task with each of its `margins`."""
    step: int = 0
    """Index of the present one."""
    _raised: int = 0

    @property
    def task(self) -> ResolvedTask:
        """The task with the present margin."""
        return self.tasks[self.step]

    def raise_after(self, audit: Audit) -> bool:
        """Raise the margin as an audit requires; False if none is large enough, or it was raised often enough."""
        step = self._next_step(audit)
        if step == len(self.tasks) or self._raised == LARGER_MARGINS:
            return False
        self.step, self._raised = step, self._raised + 1
        return True

    def _next_step(self, audit: Audit) -> int:
        """Return the step after one whose audit is not clear; beyond the last: no margin is large enough."""
        after, last = self.step + 1, len(self.tasks) - 1
        worst = None if audit.sensitivity is None else audit.sensitivity.tolerances
        if not self.task.flight.tolerances or worst is None:
            return after
        pair = (worst.kind, worst.a, worst.b, worst.segment)
        kept = (one.analytic_m for one in audit.pairs if (one.kind, one.a, one.b, one.segment) == pair)
        needed = next(kept, self.task.search.margin) - worst.lower_m  # what the errors take from that pair
        enough = (k for k in range(after, last) if self.tasks[k].search.margin >= needed)
        return next(enough, max(after, last))
