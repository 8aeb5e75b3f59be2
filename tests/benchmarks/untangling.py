"""Number of trees that can be placed without overlaps, overlaps of the others, and CPU time per start.

    python tests/benchmarks/untangling.py [--sizes 20 40 100] [--connector-distances 0.22 0.30] [--trees N]
        [--starts N] [--body-clearance] [--interference parts]

Uniformly drawn trees; starts only have to meet the geometry of `nlp.starts.untangling`, not a wrench. The first row
includes the time of compiling, unless compiled code is cached.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from older import older_task

from nlp.numbers.point import Point
from nlp.requirements.modules import module_clearances
from nlp.starts.random_starts import draw, generator
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.topologies import sample


def overlaps(task: ResolvedTask, topology: Topology, alpha: Array) -> list[tuple[int, int]]:
    """Return the pairs of modules that overlap, which untangling has to separate."""
    zero, inputs = np.zeros(3), np.zeros((0, topology.n, 4))
    vectors = Point(task, topology, zero, alpha, zero, inputs).vectors
    pairs = set[tuple[int, int]]()
    for requirement in module_clearances(task, topology):
        if not (requirement.equation == 6 and task.search.interference == "airflow"):
            overlapping = (requirement.gaps(vectors) < 0.0).any(axis=1)
            pairs |= {(min(i, j), max(i, j)) for i, j in requirement.subjects[overlapping].tolist()}
    return sorted(pairs)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[20, 40, 100])
    parser.add_argument("--connector-distances", type=float, nargs="+", default=[0.22, 0.30], help="[m]")
    parser.add_argument("--trees", type=int, default=20)
    parser.add_argument("--starts", type=int, default=5, help="largest number per tree")
    parser.add_argument("--body-clearance", action="store_true")
    parser.add_argument("--interference", choices=("airflow", "parts"), default="airflow")
    arguments = parser.parse_args()
    print(f"{'n':>4}{'l_c [m]':>9}{'untangled':>14}{'by first start':>16}{'overlaps':>11}{'CPU s a start':>15}")
    for n in arguments.sizes:
        for l_c in arguments.connector_distances:
            fields = {
                "name": "placing",
                "modules": n,
                "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}],
                "module": {"connector_distance": l_c},
                "search": {"interference": arguments.interference},
            }
            if not arguments.body_clearance:
                fields["search"]["body_clearance"] = False
            task = older_task(fields).resolve(n)
            fewest, first, seconds = [], 0, []
            for topology in sample(n, arguments.trees, seed=0):
                counts = []
                for start in range(arguments.starts):
                    started = time.process_time()
                    alpha = draw(task, topology, generator(task, topology, start, 0)).alpha
                    seconds.append(time.process_time() - started)
                    counts.append(len(overlaps(task, topology, alpha)))
                    if counts[-1] == 0:
                        break
                fewest.append(min(counts))
                first += counts[0] == 0
            unplaced = sorted(count for count in fewest if count)
            overlap = f"{np.median(unplaced):.0f}" if unplaced else "-"
            placed = f"{fewest.count(0)} / {len(fewest)}"
            row = f"{n:>4}{l_c:>9.2f}{placed:>14}{first:>16}{overlap:>11}{np.mean(seconds):>15.2f}"
            print(row, flush=True)
    print("overlaps: overlapping pairs of the best start, median over the trees that were not placed")


if __name__ == "__main__":
    main()
