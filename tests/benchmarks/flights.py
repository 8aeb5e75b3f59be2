"""Requirements of flying tasks, certified reserves of their designs, and flights under two controllers.

    python tests/benchmarks/flights.py [NAME ...] [--modules 3 ...] [--seeds 2] [--trees 3] [--runs FOLDER]

Of every flying example and number of modules the best tree is searched four times, from STARTS starts per tree:
with reserves at the tip instead (`reserves`, `tests/designs/NAME.toml`), with the centre of mass where it should
be (`centred`), as shipped (`task`), and as shipped by the pseudo-inverse. `--trees N` restricts the others to the
N best trees of the first. Finished runs in FOLDER are taken as they are. The audit certifies what the best inputs
and the pseudo-inverse reach, as shipped with the centre of mass at the worst corner. Then the design is flown with
masses and thrusts off by MODEL_ERROR: a gust of GUST from eight sides, and a tilt of TILT held about four axes,
with the bounded least squares of `fly` and with PX4's rule. A row goes to `flights.csv` of `notebooks/results` as
soon as it is known, in place of the one before; the documentation shows that table.
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
from topo_search.model.files import read_task
from topo_search.simulation.controller import Allocator, PseudoInverse
from topo_search.simulation.fly import Options, fly, judge
from topo_search.simulation.plant import Errors
from topo_search.simulation.scenarios import TILT, Scenario, tilts

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "notebooks/results/flights.csv"
NAMES = ("wall-push", "window-cleaning", "survives-a-rotor")
SIZES = (3, 4, 5)
STARTS = 4
MODEL_ERROR = 0.02
GUST = 1.0
"""[N], for a second at the centre of mass."""
GUSTS = 8
RULES = {"bounded": Allocator, "px4": PseudoInverse}
FIGURES = {
    "tip": "horizontal_reserve_N",
    "com": "horizontal_reserve_com_N",
    "tilt_deg": "tilt_deg",
    "angular_acceleration_rad_s2": "angular_acceleration_rad_s2",
}
"""Columns, forces in weights, and the figures of hover that they show."""
RULED: dict[str, tuple[str, ...]] = {
    "reserves": (),
    "centred": ("flight.com_error=0.0",),
    "task": (),
    "pseudo-inverse": ('flight.allocator="pseudo-inverse"',),
}
"""Settings of every search."""
KEY = ["task", "modules", "required"]


def scenarios() -> Iterator[Scenario]:
    """Yield gusts, then tilts."""
    for k in range(GUSTS):
        angle = 2 * math.pi * k / GUSTS
        wind = GUST * np.array([math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0])
        yield Scenario(f"gust {k}", 3.5, 3.0, gust=(0.5, 1.5), wind=wind)
    yield from tilts(TILT, counts=True)


def held(design: Design, rule: type[Allocator], seeds: int) -> dict[str, str]:
    """Return how many gusts and tilts are held."""
    counts = {"gust": [0, 0], "tilt": [0, 0]}
    for seed in range(seeds):
        options = Options(Errors(model=MODEL_ERROR, seed=seed), allocator=rule)
        for scenario in scenarios():
            count = counts[scenario.name[:4]]
            count[0] += judge(scenario, *fly(design, scenario, options)).verdict == "held"
            count[1] += 1
    return {what: f"{good} of {all_}" for what, (good, all_) in counts.items()}


def certified(design: Design) -> dict[str, float]:
    """Return the figures of hover by the best inputs and by the pseudo-inverse."""
    flight, weight = verify.audit(design).flight, design.task.force_unit(design.topology.n)
    if flight is None:
        raise ValueError("the numbers of the design are too large to compute with")
    cells = {}
    for suffix in ("", "_pseudo_inverse"):
        for column, figure in FIGURES.items():
            least = float(np.min(getattr(flight.hover, f"{figure}{suffix}")))
            cells[f"{column}{suffix}"] = round(least / weight if figure.endswith("_N") else least, 4)
    return cells


def keep(row: dict[str, object]) -> None:
    """Print a row, and put it into the table in place of the one with its key."""
    print(row, flush=True)
    before = pd.read_csv(KEPT, dtype=str) if KEPT.exists() else pd.DataFrame()
    rows = pd.concat([before, pd.DataFrame([row]).astype(str)]).drop_duplicates(KEY, keep="last")
    rows.sort_values(KEY, key=lambda column: column.map([*NAMES, *map(str, SIZES), *RULED].index)).to_csv(
        KEPT, index=False, lineterminator="\n"
    )


def main() -> None:
    """Keep the rows, each as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--modules", type=int, nargs="*", default=SIZES)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--required", nargs="*", choices=RULED, default=RULED)
    parser.add_argument("--trees", type=int)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    given = parser.parse_args()
    options = f"--seeds {given.seeds}{'' if given.trees is None else f' --trees {given.trees}'}"
    for name in given.names:
        for n in given.modules:
            trees = None
            for required, settings in RULED.items():
                first = required == "reserves"
                if required not in given.required and (not first or given.trees is None):
                    continue
                answer = search(
                    read_task(ROOT / f"tests/designs/{name}.toml" if first else name, (f"modules={n}", *settings)),
                    out=given.runs / f"{name}-{n}-{required}",
                    starts=STARTS,
                    workers=1,
                    topologies=trees,
                )
                table = answer.candidates
                if given.trees is not None and first:
                    trees = table[table.status == "feasible"].sort_values("objective").key.iloc[: given.trees]
                if required not in given.required:
                    continue
                row = {"task": name, "modules": n, "required": required, "candidates": len(table)}
                if (design := answer.design) is not None:
                    row |= {"tree": design.topology.key, "effort": f"{design.objective:.4g}", **certified(design)}
                    for rule, allocator in RULES.items():
                        row |= {
                            f"{rule}_{key}": count for key, count in held(design, allocator, given.seeds).items()
                        }
                elif "failed" in {*table["status"]}:
                    continue
                command = f"python tests/benchmarks/flights.py {name} --modules {n} {options}"
                keep(row | {"command": command})


if __name__ == "__main__":
    main()
