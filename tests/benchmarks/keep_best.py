"""Update the best known designs of the benchmark, which `topo-search audit --against NAME` compares with.

    python tests/benchmarks/keep_best.py [EXAMPLE ...] [--gap GAP]

Searches each shipped task as for the gallery. A design that is better than the shipped one, and clear, takes its
place in `topo_search/examples/best/EXAMPLE-MODULES.json`. With `--gap` branch and bound proves that no platform of
that size has less effort than the best found by more than GAP, and the bound is kept with the best design.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from keep_gallery import search_shipped

from topo_search.compose.referee import best_known
from topo_search.model.files import to_json, write_atomically
from topo_search.model.largest_value import objective_of
from topo_search.model.task_file import examples

BEST = Path(__file__).parents[2] / "topo_search/examples/best"


def main() -> None:
    """Search, compare and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=examples())
    parser.add_argument("--gap", type=float, help="relative gap of the control effort to prove, such as 0.05")
    options = parser.parse_args()
    for name in options.examples:
        answer, design, _ = search_shipped(name, options.gap)
        known, rated = best_known(name, design.task.n), objective_of(design.task)
        assert answer.best is not None
        is_better = known is None or rated.excess(known, design) > rated.excess(design, design)
        best = design if is_better and answer.best.audit == "clear" else known
        assert best is not None
        bounds = [one.lower_bound for one in (design, known) if one is not None and one.lower_bound is not None]
        if options.gap is not None and (gap := answer.sizes[0].proven_gap) is not None:
            bounds.append(design.objective * (1 - gap))
        if bounds:
            best = best.model_copy(
                update={"lower_bound": max(bounds), "gap": best.gap_of(best.objective, max(bounds))}
            )
        write_atomically(BEST / f"{name}-{design.task.n}.json", to_json(best))
        print(
            name, design.topology.key, rated.words(design, 6), "better" if is_better else "not better", flush=True
        )


if __name__ == "__main__":
    main()
