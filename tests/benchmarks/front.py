"""The gain from carrying designs over between levels of a front: each level against a plain run of its task.

python tests/benchmarks/front.py EXAMPLE [--set FIELD=VALUE] [--starts N]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from topo_search.compose import search
from topo_search.model.task_file import read_task

GOALS = ("goals.stand_off=[0.2, 0.38]", "goals.peak_input=[1.0, 0.95, 0.9]")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="FIELD=VALUE")
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    task = read_task(arguments.task, (*GOALS, *arguments.settings))
    options = {"starts": arguments.starts, "seed": arguments.seed, "workers": arguments.workers}
    print("level | goals | feasible trees: front, plain | least J: front, plain, ratio")
    with tempfile.TemporaryDirectory() as folder:
        answer = search(task, out=Path(folder) / "front", **options)
        for outcome in answer.levels:
            plain = search(task.at(outcome.level), out=Path(folder) / str(outcome.number), **options)
            for in_front, in_plain in zip(outcome.sizes, plain.sizes, strict=True):
                efforts = [size.best.objective if size.best else None for size in (in_front, in_plain)]
                efforts_text = ", ".join("none" if J is None else f"{J:.6g}" for J in efforts)
                ratio = f"{efforts[0] / efforts[1]:.6f}" if None not in efforts else ""
                feasible = f"{in_front.feasible}, {in_plain.feasible}"
                row = (str(outcome.number), outcome.level.words, feasible, f"{efforts_text}, {ratio}")
                print(" | ".join(row), flush=True)
        print(f"{len(answer.points)} designs on the front")


if __name__ == "__main__":
    main()
