"""Least clearance of the rigid parts of solved designs.

    python tests/benchmarks/touching.py push --set module.arm_length=0.135

Prints one line per tree: the audit's verdict and the least clearance of bolted neighbours and of other pairs [mm].
"""

from __future__ import annotations

import argparse

from topo_search.compose import BACKENDS
from topo_search.engine import Job
from topo_search.model import Design
from topo_search.model.task_file import read_task
from topo_search.topologies import sample


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, default=6)
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    task = read_task(arguments.task, (f"modules={arguments.modules}", *arguments.settings)).resolve(
        arguments.modules
    )
    for topology in sample(arguments.modules, arguments.trees, seed=arguments.seed):
        design = BACKENDS.solve(Job(task, topology, starts=range(arguments.starts), seed=0))
        if not isinstance(design, Design):
            print(f"{topology.key}  no design")
            continue
        audit = BACKENDS.audit(design)
        pairs = [pair for pair in audit.pairs if pair.kind == "body"]
        least = [
            min(
                (1e3 * pair.analytic_m for pair in pairs if ((pair.a, pair.b) in topology.bolted) == bolted),
                default=None,
            )
            for bolted in (True, False)
        ]
        bolted, unbolted = ("" if d is None else f"{d:.1f}" for d in least)
        print(f"{topology.key}  {audit.verdict}  bolted {bolted}  other {unbolted}", flush=True)


if __name__ == "__main__":
    main()
