"""Best effort over the lower bound without one requirement at a time, to see what keeps a proof open.

    python tests/benchmarks/left_out.py TASK --modules N [--starts 12] [--trees KEY ...]

The last rows have only the requirements that the bounds of `prove` account for: no proof can close a smaller gap
than theirs. Designs meet the solver's requirements and are not audited.
"""

import argparse
import math
import time
from collections.abc import Iterator
from typing import get_args

from nlp import lower_bound, solve
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.exposure import half_spaces
from topo_search.model.proof import Problem, proof_task
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates

FREE_TIP = {"exclusion": False, "rod": "none", "rod_deflection": None}
FIELDS: dict[str, tuple[str, dict[str, object]]] = {
    "rotor failures": ("flight", {"rotor_out": "none", "rotor_out_torque": None}),
    "the force reserve": ("flight", {"force_reserve": 0.0}),
    "the torque reserve": ("flight", {"torque_reserve": 0.0}),
    "the tip's exclusion and the rod": ("end_effector", FREE_TIP),
}


def variants(task: ResolvedTask) -> Iterator[tuple[str, ResolvedTask]]:
    """Yield the task, the task without one requirement at a time, and the parts that bounds account for."""
    yield "the whole task", task
    regions = task.exposure
    for r, region in enumerate(regions):
        remaining = regions[:r] + regions[r + 1 :]
        yield f"without exposure {r} ({region.kind})", task.model_copy(update={"exposure": remaining})
    if len(regions) > 1:
        yield "without exposure", task.model_copy(update={"exposure": ()})
    for name, (field, update) in FIELDS.items():
        original = getattr(task, field)
        if (changed := original.model_copy(update=update)) != original:
            yield f"without {name}", task.model_copy(update={field: changed})
    walls = tuple(region.model_copy(update={"solid": False}) for region in regions if half_spaces([region]))
    bounded = {"exposure": walls, "end_effector": task.end_effector.model_copy(update=FREE_TIP)}
    for scope in get_args(Problem):
        yield f"only what bounds of the {scope} account for", proof_task(task, scope).model_copy(update=bounded)


def main() -> None:
    """Solve and print a row for each variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--modules", type=int, required=True)
    parser.add_argument("--starts", type=int, default=12)
    parser.add_argument("--trees", nargs="*", help="keys; default: all")
    arguments = parser.parse_args()
    task = read_task(arguments.task).resolve(arguments.modules)
    trees = [candidate.topology for candidate in candidates(task.n, symmetry="task", task=task)]
    if arguments.trees:
        trees = [Topology.from_key(key) for key in arguments.trees]
    bound, reference = lower_bound(task), math.nan
    print(f"| `{task.name}`, n = {task.n} | over the lower bound | less than the whole task's | tree | CPU s |")
    print("|---|---|---|---|---|")
    for name, changed in variants(task):
        started, cells = time.process_time(), "no design | | "
        outcomes = [solve(changed, tree, starts=range(arguments.starts), seed=0) for tree in trees]
        if designs := [outcome for outcome in outcomes if isinstance(outcome, Design)]:
            best = min(designs, key=lambda design: design.objective)
            reference = best.objective if math.isnan(reference) else reference
            share = 100 * (1 - best.objective / reference)
            cells = f"{best.objective / bound:.4f} | {share:.2f} % | `{best.topology.key}`"
        print(f"| {name} | {cells} | {time.process_time() - started:.0f} |", flush=True)


if __name__ == "__main__":
    main()
