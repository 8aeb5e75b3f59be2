"""Requirements of flying tasks, certified reserves of their designs, and flights under two controllers.

    python tests/benchmarks/flights.py [NAME ...] [--modules 3 ...] [--seeds 5] [--runs FOLDER]

Of every flying example and number of modules the best tree is searched with REQUIRED in place of the example's own
reserves, all trees from STARTS starts each; finished runs in FOLDER are taken as they are. The audit certifies what
the best inputs and the pseudo-inverse reach. Then the design is flown with masses and thrusts off by MODEL_ERROR: a
gust of GUST from eight sides, and a tilt of TILT held about four axes, with the bounded least squares of `fly` and
with PX4's rule. Prints a table.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import verify
from topo_search import search
from topo_search.model import Design
from topo_search.model.files import read_task
from topo_search.simulation.controller import Allocator, PseudoInverse
from topo_search.simulation.fly import Options, fly, judge
from topo_search.simulation.plant import Errors
from topo_search.simulation.scenarios import TILT, Scenario, tilts

NAMES = ("wall-push", "window-cleaning", "survives-a-rotor")
SIZES = (3, 4, 5)
REQUIRED = (
    "module.min_input=0.03",
    'flight.units="weight"',
    "flight.force_reserve=0.25",
    'flight.at="com"',
    "flight.torque_reserve=0.0",
    "flight.tilt_deg=10.0",
    "flight.angular_acceleration=[11.0, 11.0, 11.0]",
    "tolerances.hinge_angle_deg=0.3",
    "tolerances.position=0.001",
)
STARTS = 4
MODEL_ERROR = 0.02
GUST = 1.0
"""[N], for a second at the centre of mass."""
GUSTS = 8
RULES = {"bounded": Allocator, "PX4": PseudoInverse}
REACHED = ("tip [W]", "centre of mass [W]", "tilt [deg]", "acceleration [rad/s^2]")
FIGURES = ("horizontal_reserve_N", "horizontal_reserve_com_N", "tilt_deg", "angular_acceleration_rad_s2")
HEAD = (
    *("task", "modules", "required by", "tree", "effort", *REACHED, *(f"pseudo-inverse: {one}" for one in REACHED)),
    *(f"{rule}: {what}" for rule in RULES for what in ("gusts", "tilts")),
)


def scenarios() -> Iterator[Scenario]:
    """Yield gusts, then tilts."""
    for k in range(GUSTS):
        angle = 2 * math.pi * k / GUSTS
        wind = GUST * np.array([math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0])
        yield Scenario(f"gust {k}", 3.5, 3.0, gust=(0.5, 1.5), wind=wind)
    yield from tilts(TILT, counts=True)


def held(design: Design, rule: type[Allocator], seeds: int) -> tuple[str, str]:
    """Return how many gusts and tilts are held."""
    counts = {"gust": [0, 0], "tilt": [0, 0]}
    for seed in range(seeds):
        options = Options(Errors(model=MODEL_ERROR, seed=seed), allocator=rule)
        for scenario in scenarios():
            count = counts[scenario.name[:4]]
            count[0] += judge(scenario, *fly(design, scenario, options)).verdict == "held"
            count[1] += 1
    gusts, tilted = (f"{good}/{all_}" for good, all_ in counts.values())
    return gusts, tilted


def certified(design: Design) -> list[str]:
    """Return the figures of hover by the best inputs, then by the pseudo-inverse."""
    flight, weight = verify.audit(design).flight, design.task.force_unit(design.topology.n)
    if flight is None:
        raise ValueError("the numbers of the design are too large to compute with")
    cells = []
    for suffix in ("", "_pseudo_inverse"):
        force, com, tilt, turn = (getattr(flight.hover, f"{figure}{suffix}") for figure in FIGURES)
        cells += [f"{force / weight:.3f}", f"{com / weight:.3f}", f"{tilt:.1f}", f"{min(turn):.1f}"]
    return cells


def main() -> None:
    """Print the table, a row as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--modules", type=int, nargs="*", default=SIZES)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--allocators", nargs="*", default=["optimal", "pseudo-inverse"])
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    given = parser.parse_args()
    print(f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}", sep="\n")
    for name in given.names:
        for n in given.modules:
            for allocator in given.allocators:
                task = read_task(name, (f"modules={n}", *REQUIRED, f'flight.allocator="{allocator}"'))
                answer = search(task, out=given.runs / f"{name}-{n}-{allocator}", starts=STARTS, workers=1)
                row = [name, str(n), allocator]
                if (design := answer.design) is not None:
                    row += [design.topology.key, f"{design.objective:.4g}", *certified(design)]
                    row += [cell for rule in RULES.values() for cell in held(design, rule, given.seeds)]
                else:
                    cut_off = "failed" in {*answer.candidates["status"]}
                    row.append("unknown: candidates failed" if cut_off else "no design")
                print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
