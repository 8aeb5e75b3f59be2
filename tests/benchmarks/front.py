"""What carrying designs over from level to level does for a front: every level beside a plain run of its task.

python tests/benchmarks/front.py EXAMPLE [--set FIELD=VALUE] [--starts N]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from topo_search.compose import search
from topo_search.model.files import read_task

GOALS = ("goals.stand_off=[0.2, 0.38]", "goals.peak_input=[1.0, 0.95, 0.9]")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="FIELD=VALUE")
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    task = read_task(given.task, (*GOALS, *given.settings))
    force = {"starts": given.starts, "seed": given.seed, "workers": given.workers}
    print("level | held at | feasible trees: front, plain | least J: front, plain, ratio")
    with tempfile.TemporaryDirectory() as folder:
        answer = search(task, out=Path(folder) / "front", **force)
        for at in answer.levels:
            plain = search(task.at(at.level), out=Path(folder) / str(at.number), **force)
            for carried, alone in zip(at.sizes, plain.sizes, strict=True):
                efforts = [size.best.objective if size.best else None for size in (carried, alone)]
                told = ", ".join("none" if J is None else f"{J:.6g}" for J in efforts)
                ratio = f"{efforts[0] / efforts[1]:.6f}" if None not in efforts else ""
                print(
                    f"{at.number} | {at.level.words} | {carried.feasible}, {alone.feasible} | {told}, {ratio}",
                    flush=True,
                )
        print(f"{len(answer.points)} designs on the front")


if __name__ == "__main__":
    main()
