"""What an experiment varies, and how much of it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

from topo_search.limits import LARGEST_INTEGER, MODULES, SECONDS, STARTS, TREES
from topo_search.model import BadInput, Fault
from topo_search.model.bad_input import nearest, show
from topo_search.model.files import examples

LARGEST_SEED = LARGEST_INTEGER - TREES
"""Tree number k draws its wrenches with the seed + k."""
FEW_ABOVE = 40
"""Modules above which the paper's scaling study, run again, makes do with fewer topologies a size."""


@dataclass(frozen=True)
class Settings:
    """The conditions of an experiment, and its random numbers."""

    tasks: tuple[tuple[str, tuple[int, ...]], ...]
    """Shipped examples, each with the numbers of modules that do it."""
    topologies: tuple[int, int]
    """Trees a size, up to FEW_ABOVE modules and above; where there are no more than that, all of them."""
    starts: int
    """Starts of each topology, at most."""
    distances: tuple[float, ...] = ()
    """Connector distances [m]; none: every task's own."""
    seed: int = 0
    """Draws topologies, wrenches and starts."""
    time_limit: float = 600.0
    """CPU seconds of a cell after which no further start is begun, where the first design ends a cell."""

    def __post_init__(self) -> None:
        known = examples()
        faults = [
            Fault("--task", f"must name a shipped example, but got {name[:80]}; {nearest(name[:80], known)}")
            for name, _ in self.tasks
            if name not in known
        ]
        numbers: dict[str, tuple[Sequence[float], float]] = {
            "sizes": ([n for _, sizes in self.tasks for n in sizes], MODULES),
            "topologies": (self.topologies, TREES),
            "starts": ([self.starts], STARTS),
            "distances": (self.distances, math.inf),
            "time-limit": ([self.time_limit], SECONDS),
        }
        faults += [
            Fault(f"--{option}", f"{rule}, but got {f'{value:g}' if isinstance(value, float) else show(value)}")
            for option, (values, most) in numbers.items()
            for value in dict.fromkeys(values)
            if (rule := _broken_rule(value, most))
        ]
        if not 0 <= self.seed <= LARGEST_SEED:
            faults.append(Fault("--seed", f"must be from 0 to {LARGEST_SEED:,}, but got {show(self.seed)}"))
        named = {"task": [name for name, _ in self.tasks], "distances": self.distances}
        faults += [
            Fault(f"--{option}", f"must have no value twice, but got {value} {values.count(value)} times")
            for option, values in named.items()
            for value in dict.fromkeys(values)
            if values.count(value) > 1
        ]
        if faults:
            raise BadInput("experiment", faults)

    def trees(self, n: int) -> int:
        """Return the most trees of n modules."""
        few, fewer = self.topologies
        return few if n <= FEW_ABOVE else fewer

    def as_json(self) -> dict[str, Any]:
        """Return them as a JSON value."""
        return {
            **asdict(self),
            "tasks": {name: list(sizes) for name, sizes in self.tasks},
            "topologies": list(self.topologies),
            "distances": list(self.distances),
        }

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """Return the settings that a JSON value of `as_json` holds."""
        tasks = tuple((name, tuple(sizes)) for name, sizes in value["tasks"].items())
        few, fewer = value["topologies"]
        return cls(**{**value, "tasks": tasks, "topologies": (few, fewer), "distances": tuple(value["distances"])})

    def as_options(self) -> str:
        """Return the options of the command line that ask for them."""
        options = [f"--task {name}:{list_text(sizes)}" for name, sizes in self.tasks]
        options += [f"--topologies {list_text(self.topologies)}", f"--starts {self.starts}"]
        if self.distances:
            options.append(f"--distances {list_text(self.distances)}")
        return " ".join([*options, f"--seed {self.seed}", f"--time-limit {list_text((self.time_limit,))}"])

    @classmethod
    def task_of(cls, text: str) -> tuple[str, tuple[int, ...]]:
        """Read TASK:SIZES, as in `ten-wrenches:10,20`."""
        match = re.fullmatch(r"([^:]+):(\d{1,9}(?:,\d{1,9})*)", text)
        if match is None:
            raise BadInput("experiment", [Fault("--task", f"must be TASK:N,N,..., but got {text[:80]}")])
        return match[1], tuple(int(n) for n in match[2].split(","))

    def override(self, **given: Any) -> Self:
        """Return these settings with those that are given and not None."""
        kept = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return type(self)(**{**kept, **{name: value for name, value in given.items() if value is not None}})


def _broken_rule(value: float, most: float) -> str | None:
    """Return which rule a number breaks."""
    if not 0 < value < math.inf:
        return "must be positive and finite"
    return f"must be at most {most:,}" if value > most else None


def list_text(values: tuple[float, ...]) -> str:
    """Return numbers as the command line takes them, to the last digit."""
    return ",".join(str(value).removesuffix(".0") for value in values)
