"""Answers of an older revision today: its designs in the present audit, its problems in the present solver.

    python tests/benchmarks/answers.py REVISION [EXAMPLE ...] [--starts N]

REVISION runs from its own source, checked out in a temporary folder: it solves the tree that wins each shipped
example today (`notebooks/results/gallery.json`) and audits the design. A row of the table shows for a tree: the
older effort over the lower bound; the change of that design's effort in the present audit; both verdicts; the
change of effort when the present solver solves the older problem, and the example in its present form.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

from reduced import OLD_STARTS, source_of

import nlp
import verify
from topo_search.model import Design, ResolvedTask
from topo_search.model.task_file import read_task

GALLERY = Path(__file__).resolve().parents[2] / "notebooks/results/gallery.json"
SOLVE = """
import json, sys
from nlp.solving import solve
from topo_search.model import Design, Topology
from topo_search.model.files import to_json
from topo_search.model.task_file import read_task
from verify import audit

name, key, starts = sys.argv[1:]
topology = Topology.from_key(key)
found = solve(read_task(name).resolve(topology.n), topology, starts=range(int(starts)), seed=0)
if not isinstance(found, Design):
    raise SystemExit(f"no design of {key} for {name}")
print(json.dumps([to_json(found), audit(found).verdict]))
"""
SAME = 1e-6
"""Relative difference below which efforts count as the same."""


def main() -> None:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision")
    parser.add_argument("examples", nargs="*", help="default: all examples of the revision")
    parser.add_argument("--starts", type=int, default=OLD_STARTS, help="starts of both solvers")
    arguments = parser.parse_args()
    gallery = json.loads(GALLERY.read_text(encoding="utf-8"))
    head = (
        "example, tree",
        "effort then, over the bound",
        "audited now",
        "verdict then, now",
        "solved now",
        "present example",
    )
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    with source_of(arguments.revision) as source:
        shipped = {path.stem for path in (source / "topo_search/examples").glob("*.toml")}
        for name in arguments.examples or sorted(shipped & gallery.keys()):
            text, verdict = _older(source, name, gallery[name]["key"], arguments.starts)
            design = Design.model_validate_json(text)
            audit, n = verify.audit(design), design.topology.n
            (effort,) = (row for row in audit.residuals if row.name == "objective")
            assert effort.derived is not None
            cells = (
                f"{name}, `{design.topology_key}`",
                f"{design.objective / nlp.lower_bound(design.task):.6f}",
                _change(effort.derived, design.objective),
                f"{verdict}, {audit.verdict}",
                _solved(design.task, design, arguments.starts),
                _solved(read_task(name).resolve(n), design, arguments.starts),
            )
            print(f"| {' | '.join(cells)} |", flush=True)


def _older(source: Path, name: str, key: str, starts: int) -> tuple[str, str]:
    """Return the design that the older solver finds, as JSON, and the verdict of the older audit."""
    process = subprocess.run(
        [sys.executable, "-c", SOLVE, name, key, str(starts)],
        env={**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"},
        cwd=source,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    text, verdict = json.loads(process.stdout)
    return text, verdict


def _solved(task: ResolvedTask, older: Design, starts: int) -> str:
    """Solve the same tree with the present solver, and return the change of effort."""
    outcome = nlp.solve(task, older.topology, starts=range(starts), seed=0)
    return _change(outcome.objective, older.objective) if isinstance(outcome, Design) else "no design"


def _change(new: float, old: float) -> str:
    change = new / old - 1
    return f"same to {SAME:g}" if abs(change) <= SAME else f"{100 * change:+.2g} %"


if __name__ == "__main__":
    main()
