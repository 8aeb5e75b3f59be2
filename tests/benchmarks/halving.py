"""What giving up the worse half of the starts costs and finds, in ways of doing it.

    python tests/benchmarks/halving.py EXAMPLE [--modules N] [--trees M] [--seeds R]
        [--ways STARTS[:STEPS:LEAST] ...]

A way is a number of starts per tree, the steps after which half of their draws are given up, and how many draws are
left at least; starts alone all go on. Uniformly drawn trees without body clearance, each from several seeds; CPU
seconds of one thread for all trees, and designs, are means over the seeds. The best known effort of a tree is the
least of all that were found.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import NamedTuple
from unittest.mock import patch

from reduced import mean_and_most, within

import nlp
from nlp.reduced import search
from topo_search.model import Design
from topo_search.model.files import read_task
from topo_search.topologies import sample


class Way(NamedTuple):
    """How many starts descend, and which of them go on."""

    starts: int
    steps: int = 0
    least: int = sys.maxsize


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example")
    parser.add_argument("--modules", type=int, default=7)
    parser.add_argument("--trees", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--ways",
        nargs="+",
        type=_way,
        default=[Way(16), Way(20, search.SELECTION.halving_step, search.SELECTION.min_starts)],
    )
    arguments = parser.parse_args()
    ways: list[Way] = arguments.ways
    task = read_task(arguments.example, (f"modules={arguments.modules}", "search.body_clearance=false"))
    resolved = task.resolve(arguments.modules)
    trees = sample(arguments.modules, arguments.trees, 0, symmetry="task", task=resolved)
    nlp.solve(resolved, trees[0], starts=range(1), seed=0)  # compiled code is loaded, or made
    efforts: dict[Way, list[tuple[str, float]]] = {way: [] for way in ways}
    seconds = dict.fromkeys(ways, 0.0)
    for seed in range(arguments.seeds):
        for tree in trees:
            for way in ways:
                began = time.process_time()
                with patch.object(
                    search, "SELECTION", search.SELECTION._replace(halving_step=way.steps, min_starts=way.least)
                ):
                    found = nlp.solve(resolved, tree, starts=range(way.starts), seed=seed)
                seconds[way] += time.process_time() - began
                if isinstance(found, Design):
                    efforts[way].append((tree.key, found.objective))
    best: dict[str, float] = {}
    for key, J in (one for found in efforts.values() for one in found):
        best[key] = min(J, best.get(key, J))
    print(f"{arguments.example}, n = {arguments.modules}: {len(trees)} trees drawn")
    print("| starts | designs | within 0.1 % | mean, most over best known | CPU s |")
    print("|" + "---|" * 5)
    for way in ways:
        over = [J / best[key] - 1 for key, J in efforts[way]]
        counts = (len(over) / arguments.seeds, within(over) / arguments.seeds)
        halved = f"halved after {way.steps} to {way.least}" if way.steps else "all go on"
        cells = (f"{way.starts}, {halved}", *(f"{count:.1f}" for count in counts), mean_and_most(over))
        print(f"| {' | '.join(cells)} | {seconds[way] / arguments.seeds:.2f} |")


def _way(text: str) -> Way:
    """Return the way that an argument names."""
    return Way(*(int(part) for part in text.split(":")))


if __name__ == "__main__":
    main()
