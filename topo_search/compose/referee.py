"""The referee of the benchmark: anybody's design, judged by a named task in place of its own.

Of the design's file only its geometry and rotor inputs count; effort and value are computed anew.
"""

from __future__ import annotations

import math
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

import verify
from topo_search.compose.binding import BACKENDS
from topo_search.compose.maximizing import measure_reserve
from topo_search.model import Audit, BadInput, Design, Geometry, Task, objective_of
from topo_search.model.files import read_json, validate
from topo_search.model.maximized import RESERVES
from verify.kinematics import objective


class Judged(NamedTuple):
    """A design judged by a task."""

    design: Design
    audit: Audit
    best: Design | None
    """The best known design of that task with as many modules; None if none is shipped."""
    bound: float
    """Proven bound of the effort [rad^4/s^4], or of the value that the task maximises."""

    def lines(self) -> list[str]:
        """Return the design's number beside the best known and the bound, in words."""
        rated, n = objective_of(self.design.task), self.design.task.n
        words = rated.words(self.design, 5)
        if self.best is not None:
            own, known = rated.number(self.design) or 0.0, rated.number(self.best) or 0.0
            is_better = own < known if rated.better == "less" else own > known
            share = f"{100 * abs(own / known - 1) if known else 0.0:.2f}"
            than = f"{share} % {'better' if is_better else 'worse'} than"
            words += f", {than if float(share) else 'as good as'} the best known, {self.best.topology.key}"
        return [f"  {words}", f"  proven for every platform of {n} modules: {rated.claim(self.bound)}"]

    def figures(self) -> dict[str, float | str | None]:
        """Return the same as values of JSON."""
        rated, best = objective_of(self.design.task), self.best
        return {
            "objective": self.design.objective,
            "value": self.design.value,
            "best_known": None if best is None else rated.number(best),
            "best_known_key": None if best is None else best.topology.key,
            "bound": self.bound,
        }


def judge(data: Any, source: str, name: str, task: Task) -> Judged:
    """Judge a design by a task.

    Args:
        data: the design's file as JSON data; `task` and `objective` may be absent.
        source: name of the file in messages.
        name: name of the task in messages, and of its best known designs.
        task: the task.

    Raises:
        BadInput: not a design, or one with other numbers of modules or load cases than the task's.
    """
    if not isinstance(data, dict):
        raise BadInput(source, "must be a design: a JSON object")
    rows, closures = data.get("topology"), data.get("closures", ())
    n, sizes = len(rows) if isinstance(rows, list) else 0, task.sizes
    if isinstance(rows, list) and n not in sizes:
        allowed = " or ".join(map(str, sizes))
        raise BadInput(source, f"topology: must have {allowed} modules for {name}, but got {n}")
    if task.search.maximize not in (None, *RESERVES):
        raise BadInput(name, f"search.maximize: must be a reserve for this command, but got {task.search.maximize}")
    resolved = task.resolve(n or sizes[0]).with_closures(len(closures) if isinstance(closures, list) else 0)
    fields = {field: data[field] for field in Geometry.model_fields if field in data}
    geometry = validate(Geometry, {**fields, "task": resolved.model_dump(mode="json")}, source)
    design = verify.complete(geometry)
    if (inputs := data.get("rotor_speeds_squared")) is not None:
        design = _with_inputs(design, inputs, source, name)
    design, _ = measure_reserve(design, design.task)
    best, bound = best_known(name, n), BACKENDS.lower_bound(resolved)
    return Judged(design, BACKENDS.audit(design), best, tightest_bound(best, bound))


def tightest_bound(best: Design | None, bound: float) -> float:
    """Return the bound in closed form, or the larger one that branch and bound proved for this size."""
    return max(bound, best.lower_bound or 0.0) if best is not None and best.value is None else bound


def _with_inputs(design: Design, inputs: Any, source: str, name: str) -> Design:
    cases = len(design.task.load_cases)
    if isinstance(inputs, list) and len(inputs) != cases:
        rule = f"must have a row for each of the {cases} load cases of {name}, but got {len(inputs)} rows"
        raise BadInput(source, f"rotor_speeds_squared: {rule}")
    given = validate(Design, {**design.model_dump(mode="json"), "rotor_speeds_squared": inputs}, source)
    with np.errstate(over="ignore"):
        J = objective(given)
    if not math.isfinite(J):
        raise BadInput(source, f"rotor_speeds_squared: must have a finite control effort, but got {J}")
    return given.model_copy(update={"task": design.task, "inputs_computed": False, "objective": J})


def best_known(name: str, n: int) -> Design | None:
    """Return the best known design of a shipped task with n modules, if one is shipped."""
    file = resources.files("topo_search") / "examples" / "best" / f"{name}-{n}.json"
    with resources.as_file(file) as path:
        return read_json(Design, path) if path.exists() else None
