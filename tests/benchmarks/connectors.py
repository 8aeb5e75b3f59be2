"""The gain from attaching children by any port instead of only by the one that keeps arms aligned.

    python tests/benchmarks/connectors.py [--modules N ...] [--starts N] [--workers N] [EXAMPLE ...]

Searches every tree with every assignment of connectors, including the aligned ones, and prints for aligned and
other assignments the number of candidates, the number that are feasible and the best effort over the lower bound;
last, the gain of the best assignment of all over the best aligned one. Only the parity of a port matters, which
sets the spins of the child.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import topo_search
from topo_search.model.task_file import read_task

EXAMPLES = ("push", "push-local", "push-directional", "push-exterior-60", "push-exterior-90", "ten-wrenches")


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=EXAMPLES)
    parser.add_argument("--modules", type=int, nargs="+", default=[3, 4])
    parser.add_argument("--starts", type=int, help="default: the solver's")
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    family = f"{'trees':>8}{'feasible':>10}{'J / bound':>11}"
    print(f"{'':26}{'all aligned':^29}{'any other':^29}")
    print(f"{'example':18}{'modules':>8}{family}{family}{'gain':>9}")
    for example in arguments.examples:
        for n in arguments.modules:
            task = read_task(example, (f"modules={n}", 'search.connectors="any"'))
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "run"
                answer = topo_search.search(task, out=out, starts=arguments.starts, workers=arguments.workers)
                table = answer.candidates
            bound, cells, least = answer.sizes[0].lower_bound, "", {}
            for letter in "ap":
                trees = table[table.key.str.startswith(letter)]
                designs = trees[trees.status == "feasible"]
                least[letter] = float(designs.objective.min()) if len(designs) else float("inf")
                ratio = f"{least[letter] / bound:.4f}" if len(designs) else "none"
                cells += f"{len(trees):>8}{len(designs):>10}{ratio:>11}"
            best = min(least.values())
            gain = f"{100 * (1 - best / least['a']):.2f} %" if best < float("inf") else ""
            print(f"{example:18}{n:>8}{cells}{gain:>9}", flush=True)


if __name__ == "__main__":
    main()
