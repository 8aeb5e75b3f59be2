"""Cost of hinge angles from a set, and the gap that the search over the set leaves.

    python tests/benchmarks/hinge_sets.py [--modules N ...] [--trees N] [--steps DEG ...] [--set FIELD=VALUE]
        [--all] [TASK ...]

Searches every tree, or `--trees` random ones, with free hinge angles, then with multiples of each step. Prints the
increase of the best effort of these trees, the number with a design, and the CPU time over that with free angles.
`--all` also tries every combination of angles from every local optimum, and prints the effort that the search
misses.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from nlp import hinge_sets, solve
from nlp.solving import default_starts
from topo_search.model import Design, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates, sample


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=["push"], metavar="TASK")
    parser.add_argument("--modules", type=int, nargs="+", default=[3])
    parser.add_argument("--trees", type=int)
    parser.add_argument("--steps", type=float, nargs="+", default=[5.0, 10.0, 15.0, 30.0, 45.0])
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--all", action="store_true")
    arguments = parser.parse_args()
    missed = f"{'missed':>10}" if arguments.all else ""
    print(f"{'example':18}{'modules':>8}{'step':>7}{'costs':>10}{'feasible':>10}{'CPU time':>10}{missed}")
    for example in arguments.examples:
        for n in arguments.modules:
            settings = [f"modules={n}", *arguments.settings]
            task = read_task(example, settings).resolve(n)
            if arguments.trees:
                trees = list(sample(n, arguments.trees, seed=0))
            else:
                trees = [candidate.topology for candidate in candidates(n, symmetry="task", task=task)]
            search(example, n, settings, trees)  # loads code
            free, _, seconds = search(example, n, settings, trees)
            for step in arguments.steps:
                stepped = [*settings, f"search.hinge_step_deg={step}"]
                least, feasible, step_seconds = search(example, n, stepped, trees)
                line = f"{example:18}{n:>8}{step:>7g}{increase(least, free):>10}{f'{feasible} of {len(trees)}':>10}"
                line += f"{step_seconds / seconds:>10.2f}"
                if arguments.all:
                    limits = hinge_sets.SEARCH, hinge_sets.MAX_REDUCED
                    hinge_sets.SEARCH, hinge_sets.MAX_REDUCED = limits[0]._replace(complete_up_to=10**9), 10**9
                    exhaustive, _, _ = search(example, n, stepped, trees)
                    hinge_sets.SEARCH, hinge_sets.MAX_REDUCED = limits
                    line += f"{increase(least, exhaustive):>10}"
                print(line, flush=True)


def search(example: str, n: int, settings: Sequence[str], trees: Sequence[Topology]) -> tuple[float, int, float]:
    """Return the least effort of all trees, the number with a design, and the CPU time [s]."""
    task, started = read_task(example, settings), time.process_time()
    starts = range(default_starts(task))
    outcomes = [solve(task.resolve(n), tree, starts=starts, seed=0) for tree in trees]
    efforts = [outcome.objective for outcome in outcomes if isinstance(outcome, Design)]
    return min(efforts, default=float("inf")), len(efforts), time.process_time() - started


def increase(effort: float, reference: float) -> str:
    """Return the increase of an effort over another one, as a percentage."""
    if effort == float("inf"):
        return "none" if reference < effort else "0.00 %"
    return f"{100 * (effort / reference - 1):.2f} %"


if __name__ == "__main__":
    main()
