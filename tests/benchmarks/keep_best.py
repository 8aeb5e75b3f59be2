"""Update the best known designs of the benchmark, which `topo-search audit --against NAME` compares with.

    python tests/benchmarks/keep_best.py [EXAMPLE ...]

Searches each shipped task as for the gallery. A design that is better than the shipped one, and clear, takes its
place in `topo_search/examples/best/EXAMPLE-MODULES.json`.
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
    for name in parser.parse_args().examples:
        answer, design, _ = search_shipped(name)
        known, rated = best_known(name, design.task.n), objective_of(design.task)
        assert answer.best is not None
        is_better = known is None or rated.excess(known, design) > rated.excess(design, design)
        if is_better and answer.best.audit == "clear":
            write_atomically(BEST / f"{name}-{design.task.n}.json", to_json(design))
        print(
            name, design.topology.key, rated.words(design, 6), "better" if is_better else "not better", flush=True
        )


if __name__ == "__main__":
    main()
