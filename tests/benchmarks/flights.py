"""Requirements of flying tasks, certified reserves of their designs, and flights with two controllers.

    python tests/benchmarks/flights.py [NAME ...] [--modules 3 ...] [--seeds 2] [--trees 3] [--runs FOLDER]

Every flying example is searched four times for each number of modules, with STARTS starts per tree: with reserves
at the tip instead (`reserves`, `tests/designs/NAME.toml`), without an error of the centre of mass (`centred`), as
shipped (`task`), and as shipped with the pseudo-inverse. `--trees N` restricts the last three to the N best trees
of the first. Finished runs in FOLDER are reused. The audit certifies the reserves of the best inputs and of the
pseudo-inverse, with the centre of mass at the worst corner of its error. The design is then flown with masses and
thrusts off by MODEL_ERROR: a gust of GUST from eight sides and a tilt of TILT about four axes, with the bounded
least squares of `fly` and with PX4's rule. Each finished row replaces its predecessor in
`notebooks/results/flights.csv`, which the documentation shows.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import verify
from topo_search import search
from topo_search.model import Design
from topo_search.model.task_file import read_task
from topo_search.simulation.controller import Allocator, PseudoInverseAllocator
from topo_search.simulation.fly import Options, fly, judge
from topo_search.simulation.plant import ModelErrors
from topo_search.simulation.scenarios import TILT, Scenario, tilts

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "notebooks/results/flights.csv"
NAMES = ("wall-push", "window-cleaning", "survives-a-rotor")
SIZES = (3, 4, 5)
STARTS = 4
MODEL_ERROR = 0.02
GUST = 1.0
"""Force at the centre of mass for one second [N]."""
GUSTS = 8
RULES = {"bounded": Allocator, "px4": PseudoInverseAllocator}
FIGURES = {
    "tip": "horizontal_reserve_N",
    "com": "horizontal_reserve_com_N",
    "tilt_deg": "tilt_deg",
    "angular_acceleration_rad_s2": "angular_acceleration_rad_s2",
}
"""Figures of hover by column of the table, where forces are in units of weight."""
SEARCHES: dict[str, tuple[str, ...]] = {
    "reserves": (),
    "centred": ("flight.com_error=0.0",),
    "task": (),
    "pseudo-inverse": ('flight.allocator="pseudo-inverse"',),
}
"""Settings of each search."""
KEY = ["task", "modules", "required"]


def scenarios() -> Iterator[Scenario]:
    """Yield the gusts, then the tilts."""
    for k in range(GUSTS):
        angle = 2 * math.pi * k / GUSTS
        wind = GUST * np.array([math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0])
        yield Scenario(f"gust {k}", 3.5, 3.0, gust=(0.5, 1.5), wind=wind)
    yield from tilts(TILT, counts=True)


def count_held(design: Design, rule: type[Allocator], seeds: int) -> dict[str, str]:
    """Fly the scenarios and return how many gusts and tilts are held."""
    counts = {"gust": [0, 0], "tilt": [0, 0]}
    for seed in range(seeds):
        options = Options(ModelErrors(model=MODEL_ERROR, seed=seed), allocator=rule)
        for scenario in scenarios():
            count = counts[scenario.name[:4]]
            count[0] += judge(scenario, *fly(design, scenario, options)).verdict == "held"
            count[1] += 1
    return {kind: f"{good} of {total}" for kind, (good, total) in counts.items()}


def certified_reserves(design: Design) -> dict[str, float]:
    """Return the certified figures of hover for the best inputs and for the pseudo-inverse."""
    flight, weight = verify.audit(design).flight, design.task.force_unit(design.topology.n)
    if flight is None:
        raise ValueError("the numbers of the design are too large to compute with")
    cells = {}
    for suffix in ("", "_pseudo_inverse"):
        for column, figure in FIGURES.items():
            least = float(np.min(getattr(flight.hover, f"{figure}{suffix}")))
            cells[f"{column}{suffix}"] = round(least / weight if figure.endswith("_N") else least, 4)
    return cells


def write_row(row: dict[str, object]) -> None:
    """Print a row, and write it to the table in place of the row with its key."""
    print(row, flush=True)
    old = pd.read_csv(TABLE, dtype=str) if TABLE.exists() else pd.DataFrame()
    rows = pd.concat([old, pd.DataFrame([row]).astype(str)]).drop_duplicates(KEY, keep="last")
    rows.sort_values(KEY, key=lambda column: column.map([*NAMES, *map(str, SIZES), *SEARCHES].index)).to_csv(
        TABLE, index=False, lineterminator="\n"
    )


def main() -> None:
    """Search, audit and fly, and write a row for each search."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--modules", type=int, nargs="*", default=SIZES)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--required", nargs="*", choices=SEARCHES, default=SEARCHES)
    parser.add_argument("--trees", type=int)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    arguments = parser.parse_args()
    options = f"--seeds {arguments.seeds}{'' if arguments.trees is None else f' --trees {arguments.trees}'}"
    for name in arguments.names:
        for n in arguments.modules:
            trees = None
            for required, settings in SEARCHES.items():
                first = required == "reserves"
                if required not in arguments.required and (not first or arguments.trees is None):
                    continue
                answer = search(
                    read_task(ROOT / f"tests/designs/{name}.toml" if first else name, (f"modules={n}", *settings)),
                    out=arguments.runs / f"{name}-{n}-{required}",
                    starts=STARTS,
                    workers=1,
                    topologies=trees,
                )
                table = answer.candidates
                if arguments.trees is not None and first:
                    trees = table[table.status == "feasible"].sort_values("objective").key.iloc[: arguments.trees]
                if required not in arguments.required:
                    continue
                row = {"task": name, "modules": n, "required": required, "candidates": len(table)}
                if (design := answer.design) is not None:
                    row |= {
                        "tree": design.topology.key,
                        "effort": f"{design.objective:.4g}",
                        **certified_reserves(design),
                    }
                    for rule, allocator in RULES.items():
                        row |= {
                            f"{rule}_{key}": count
                            for key, count in count_held(design, allocator, arguments.seeds).items()
                        }
                elif "failed" in {*table["status"]}:
                    continue
                command = f"python tests/benchmarks/flights.py {name} --modules {n} {options}"
                write_row(row | {"command": command})


if __name__ == "__main__":
    main()
