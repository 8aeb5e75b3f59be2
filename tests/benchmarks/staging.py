"""What it brings to try a start again in two stages, first without the cone that all airflow must stay in.

    python tests/benchmarks/staging.py [EXAMPLE] [--modules N] [--trees M] [--starts S] [--set FIELD=VALUE ...]

Every tree up to a half turn, or M uniformly drawn ones, each solved from S starts as the problem stands, and from
the same starts with the second try. Times are CPU seconds.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from attempts import effort

from nlp.bounds import prove_impossible
from nlp.evaluate import violations, worst
from nlp.finish import finish
from nlp.one_stage import one_stage
from nlp.starts import draw, generator
from nlp.two_stages import TwoStages
from topo_search.model.files import read_task
from topo_search.topologies import candidates, sample

WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push-exterior-60")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, help="uniformly drawn ones; default: all")
    parser.add_argument("--starts", type=int, default=8, help="starts of each tree")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    n = arguments.modules
    task = read_task(arguments.example, (f"modules={n}", *arguments.settings)).resolve(n)
    trees = [candidate.topology for candidate in candidates(n)] if arguments.trees is None else []
    trees = [tree for tree in trees or sample(n, arguments.trees, 0) if prove_impossible(task, tree) is None]
    ways = {"one stage": one_stage, "two where one does not do": TwoStages}
    J = {way: np.full((len(trees), arguments.starts), np.inf) for way in ways}
    seconds = dict.fromkeys(ways, 0.0)
    for row, tree in enumerate(trees):
        starts = [draw(task, tree, generator(task, tree, start, 0)) for start in range(arguments.starts)]
        for way, make in ways.items():
            began = time.process_time()
            ready = make(task, tree)
            for column, start in enumerate(starts):
                point = finish(ready.solve(start).point)
                J[way][row, column] = effort(point) if worst(violations(point)).met else np.inf
            seconds[way] += time.process_time() - began
    best = np.min([efforts.min(axis=1) for efforts in J.values()], axis=0)
    print(f"{arguments.example}, n = {n}, {' '.join(arguments.settings)}")
    print(f"{len(trees)} trees that are not proven impossible, {np.isfinite(best).sum()} with a design")
    print(
        "| stages | designs, of all starts | trees with a design | within 0.1 % of best | least J | CPU s a start |"
    )
    print("|---|---|---|---|---|---|")
    for way, efforts in J.items():
        least = efforts.min(axis=1)
        at_best = np.isfinite(least) & (least <= (1 + WITHIN) * best)
        cells = (
            f"{np.isfinite(efforts).mean():.1%} | {np.isfinite(least).sum()} | {at_best.sum()} | {least.min():.4e}"
        )
        print(f"| {way} | {cells} | {seconds[way] / efforts.size:.3f} |")


if __name__ == "__main__":
    main()
