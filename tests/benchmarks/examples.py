"""Exhaustive searches of the shipped five-module examples, by default and as the paper poses them.

    python tests/benchmarks/examples.py [--starts N] [--workers N] [--problems NAME ...] [EXAMPLE ...]

Prints for each the best control effort over the closed-form bound, the number of feasible trees and the audit of
the winner. Trees are counted up to a half turn and whichever module is the root; in the paper's problem every root
of a tree is a candidate. The problems: `default`; `clearances`, with the paper's clearances, between airflow only;
`paper`, the paper's literal problem, as in `topo-search run EXAMPLE --paper`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import nlp
import topo_search
from topo_search.experiments.comparisons import tree_of
from topo_search.model import Audit, Design
from topo_search.model.files import read_json
from topo_search.model.task_file import PAPER, read_task
from topo_search.study import Answer

EXAMPLES = (
    "push", "push-local", "push-directional", "push-two-paths", "push-exterior-60", "push-exterior-90",
)  # fmt: skip
PROBLEMS = {"default": (), "clearances": ("search.body_clearance=false",), "paper": PAPER}


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=EXAMPLES)
    parser.add_argument("--starts", type=int, help="default: the solver's")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=[*PROBLEMS])
    arguments = parser.parse_args()
    print(f"{'example':20}{'problem':18}{'best J / bound':>15}{'feasible trees':>16}{'audit':>10}{'seconds':>9}")
    for example in arguments.examples:
        for problem in arguments.problems:
            task = read_task(example, PROBLEMS[problem])
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "run"
                started = time.perf_counter()
                answer = topo_search.search(task, out=out, starts=arguments.starts, workers=arguments.workers)
                seconds = time.perf_counter() - started
                best, ratio, verdict = answer.best, "none", ""
                if best is not None:
                    design = read_json(Design, out / "best.json")
                    ratio = f"{design.objective / nlp.lower_bound(design.task):.4f}"
                    verdict = read_json(Audit, out / "audits" / f"{best.key}.json").verdict
                feasible = feasible_trees(answer)
            print(f"{example:20}{problem:18}{ratio:>15}{feasible:>16}{verdict:>10}{seconds:>9.0f}", flush=True)


def feasible_trees(answer: Answer) -> int:
    """Return the number of trees with a design, up to a half turn and whichever module is the root."""
    rows = answer.candidates
    feasible = rows[rows["status"] == "feasible"]
    return int(feasible.groupby(feasible["key"].map(tree_of))["orbit"].max().sum())


if __name__ == "__main__":
    main()
