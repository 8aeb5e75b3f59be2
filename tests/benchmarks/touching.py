"""How near the rigid parts of solved designs come to each other, for modules of several shapes.

    python tests/benchmarks/touching.py push --set module.arm_length=0.135

prints one line per tree: the audit's verdict and the least clearance of bolted neighbours and of other pairs [mm].
"""

from __future__ import annotations

import argparse

from topo_search.compose import BACKENDS
from topo_search.model import Design
from topo_search.model.files import read_task
from topo_search.topologies import sample


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, default=6)
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    task = read_task(given.task, (f"modules={given.modules}", *given.settings)).resolve(given.modules)
    for topology in sample(given.modules, given.trees, seed=given.seed):
        design = BACKENDS.solve(task, topology, starts=range(given.starts), seed=0)
        if not isinstance(design, Design):
            print(f"{topology.key}  no design")
            continue
        audit = BACKENDS.audit(design)
        rows = [pair for pair in audit.pairs if pair.kind == "body"]
        least = [
            min(
                (1e3 * row.analytic_m for row in rows if ((row.a, row.b) in topology.bolted) == bolted),
                default=None,
            )
            for bolted in (True, False)
        ]
        bolted, other = ("" if d is None else f"{d:.1f}" for d in least)
        print(f"{topology.key}  {audit.verdict}  bolted {bolted}  other {other}", flush=True)


if __name__ == "__main__":
    main()
