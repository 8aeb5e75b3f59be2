"""CPU time of choosing a drawer of brackets for large platforms.

    python tests/benchmarks/drawer.py [--modules N] [--tasks T] [--choices C ...] [--step DEG]

The choices are synthetic: uniformly drawn trees, hinge angles drawn from multiples of the step, efforts within 2 %.
Half of a task's trees are those of the task before, with a quarter of the angles redrawn, so that parts are shared.
Prints the CPU time of the choice, the number of brackets in the drawer, and the number that the designs of least
effort would need.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections import Counter

from topo_search.compose.choosing import choose, count_kinds
from topo_search.model import Design
from topo_search.model.task_file import read_task
from topo_search.topologies import sample


def main() -> None:
    """Draw, choose and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", type=int, default=20)
    parser.add_argument("--tasks", type=int, default=3)
    parser.add_argument("--choices", type=int, nargs="+", default=[10, 30, 100, 300])
    parser.add_argument("--step", type=float, default=15.0)
    arguments = parser.parse_args()
    print(f"{'modules':>8}{'tasks':>7}{'choices':>9}{'CPU time':>10}{'brackets':>10}{'of the best':>13}")
    for count in arguments.choices:
        choices = synthetic_choices(arguments.modules, arguments.tasks, count, arguments.step)
        started = time.process_time()
        chosen = choose(choices)
        seconds = time.process_time() - started
        sizes = [
            drawer_size([designs[d] for designs, d in zip(choices, indices, strict=True)])
            for indices in (chosen, [0] * arguments.tasks)
        ]
        row = f"{arguments.modules:>8}{arguments.tasks:>7}{count:>9}{seconds:>8.1f} s{sizes[0]:>10}{sizes[1]:>13}"
        print(row, flush=True)


def synthetic_choices(n: int, tasks: int, count: int, step: float) -> list[list[Design]]:
    """Return designs for each task, by effort."""
    draw, task = random.Random(0), read_task("push", (f"modules={n}",)).resolve(n)
    angles = [k * step for k in range(-int(90 / step), int(90 / step) + 1)]
    trees = list(sample(n, count * tasks, seed=0))
    choices: list[list[Design]] = []
    for number in range(tasks):
        designs = []
        for k in range(count):
            tree = trees[number * count + k]
            hinges_deg = [draw.choice(angles) for _ in range(n - 1)]
            if number and k % 2:
                before = choices[-1][k]
                tree = before.topology
                old_deg = [math.degrees(alpha) for alpha in before.hinge_angles_rad]
                hinges_deg = [a if draw.random() < 0.75 else b for a, b in zip(old_deg, hinges_deg, strict=True)]
            designs.append(
                Design(
                    task=task,
                    topology=tree,
                    topology_key=tree.key,
                    root_orientation_rad=(0.0, 0.0, 0.0),
                    hinge_angles_rad=tuple(map(math.radians, hinges_deg)),
                    end_effector_m=(0.0, 0.0, 1.0),
                    rotor_speeds_squared=((1.0,) * (4 * n),) * len(task.load_cases),
                    objective=1 + 0.02 * k / count,
                    lower_bound=None,
                    gap=None,
                )
            )
        choices.append(designs)
    return choices


def drawer_size(designs: list[Design]) -> int:
    """Return the number of brackets that serve all designs."""
    drawer = Counter[float]()
    for design in designs:
        drawer |= count_kinds(design)
    return drawer.total()


if __name__ == "__main__":
    main()
