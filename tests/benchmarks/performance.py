"""The solver against a direct implementation of the paper's formulation, and its limits.

    python tests/benchmarks/performance.py [PART ...] [--out ROWS.jsonl]

| part | measures |
|---|---|
| five | all trees of five modules: time until nearly all reach their best known effort, both methods in turn |
| shared | building and solving from one start, both methods |
| random | each method from its own starts until the first design |
| share | share of topologies with a design after a few starts, by exposure and connector distance |
| hundred | a hundred modules: time, memory, audit, and reasons for failure |
| best | large platforms: the first design, and the best after two minutes |
| growth | time and memory against the number of modules, and the distribution of time |

Times are CPU times of one process with one thread, after modules and compiled code have been loaded. Every row is
appended to the file, and rows that it already has are not measured again; tables show all rows of the file.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import part_best
import part_five
import part_growth
import part_hundred
import part_random
import part_share
import part_shared
from options import Options
from rows import Rows

PARTS = {
    part.PART: part
    for part in (part_five, part_shared, part_random, part_share, part_hundred, part_best, part_growth)
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("performance.jsonl"), help="file of the measured rows")
    parser.add_argument("--sizes", type=int, nargs="+", help="numbers of modules; default: those of the part")
    parser.add_argument("--topologies", type=int, default=Options.topologies, help="topologies drawn for each size")
    parser.add_argument("--starts", type=int, default=Options.starts, help="largest number of starts per topology")
    parser.add_argument("--cap", type=int, default=Options.cap, help="largest CPU time of one measurement [s]")
    parser.add_argument("--seconds", type=float, default=Options.seconds, help="five: CPU time of each method [s]")
    parser.add_argument("--distances", type=float, nargs="+", help="share, hundred, best: connector distances [m]")
    parser.add_argument("--examples", nargs="+", help="share: tasks; the first one is measured at all distances")
    parser.add_argument("--direct-up-to", type=int, default=Options.direct_up_to, help="growth: its largest size")
    arguments = vars(parser.parse_args())
    parts, rows = arguments.pop("parts") or list(PARTS), Rows(arguments.pop("out"))
    if unknown := set(parts) - set(PARTS):
        parser.error(f"`PART` must be one of {', '.join(PARTS)}, but got {', '.join(sorted(unknown))}")
    os.environ["OMP_NUM_THREADS"] = "1"  # for the child processes
    sizes = arguments.pop("sizes")
    for name in ("distances", "examples"):
        arguments[name] = tuple(arguments[name] or ())
    for name in parts:
        part = PARTS[name]
        part.measure(rows, Options(tuple(sizes or part.SIZES), **arguments))
        print(f"\n{name}\n\n{part.table(rows)}", flush=True)


if __name__ == "__main__":
    main()
