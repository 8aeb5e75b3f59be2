"""The solver against the paper's formulation written directly, and how far it reaches.

    python tests/benchmarks/performance.py [PART ...] [--out ROWS.jsonl]

Times are CPU seconds of one process with one thread. Every measured row is appended to the file, and what it holds
already is not measured again; the tables are made from all of its rows.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import part_five
import part_shared
from rows import Rows

PARTS = {"five": part_five, "shared": part_shared}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--out", type=Path, default=Path("performance.jsonl"), help="file of the measured rows")
    parser.add_argument("--modules", type=int, default=5, help="five: modules")
    parser.add_argument("--seconds", type=float, default=600.0, help="five: CPU seconds of each method")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 40])
    parser.add_argument("--topologies", type=int, default=10, help="uniformly drawn topologies of each size")
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--cap", type=int, default=600, help="most CPU seconds of one measurement")
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # for the children
    rows = Rows(arguments.out)
    sampled = {name: getattr(arguments, name) for name in ("sizes", "topologies", "starts", "cap")}
    for part in arguments.parts:
        match part:
            case "five":
                part_five.measure(rows, example="push", n=arguments.modules, seconds=arguments.seconds)
            case "shared":
                part_shared.measure(rows, example="ten-wrenches", **sampled)
            case _:
                parser.error(f"`PART` must be one of {', '.join(PARTS)}, but got {part}")
        print(f"\n{part}\n\n{PARTS[part].table(rows)}", flush=True)


if __name__ == "__main__":
    main()
