"""The shipped five-module examples, searched exhaustively with and without body clearance.

    python tests/benchmarks/examples.py [--starts N] [--workers N] [EXAMPLE ...]

Prints, for each, the best control effort over the closed-form bound, the number of feasible trees (trees up to a
half turn, counted as the sum of `orbit`) and the audit of the winner.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import nlp
import topo_search
from topo_search.model import Audit, Design
from topo_search.model.files import read_json, read_task

EXAMPLES = (
    "push", "push-local", "push-directional", "push-two-paths", "push-exterior-60", "push-exterior-90",
)  # fmt: skip
PROBLEMS = {"body clearance": (), "literal": ("search.body_clearance=false",)}


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=EXAMPLES)
    parser.add_argument("--starts", type=int, default=nlp.DEFAULT_STARTS)
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    print(f"{'example':20}{'problem':18}{'best J / bound':>15}{'feasible trees':>16}{'audit':>10}{'seconds':>9}")
    for example in arguments.examples:
        for problem, settings in PROBLEMS.items():
            task = read_task(example, settings)
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "run"
                began = time.perf_counter()
                answer = topo_search.search(task, out=out, starts=arguments.starts, workers=arguments.workers)
                seconds = time.perf_counter() - began
                best, ratio, verdict = answer.best, "none", ""
                if best is not None:
                    design = read_json(Design, out / "best.json")
                    ratio = f"{design.objective / nlp.lower_bound(design.task):.4f}"
                    verdict = read_json(Audit, out / "audits" / f"{best.key}.json").verdict
                feasible = sum(size.feasible for size in answer.sizes)
            print(f"{example:20}{problem:18}{ratio:>15}{feasible:>16}{verdict:>10}{seconds:>9.0f}", flush=True)


if __name__ == "__main__":
    main()
