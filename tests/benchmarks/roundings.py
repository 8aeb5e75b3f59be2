"""Winners whose hinge angles are rounded: roundings tried, their cost in effort, the largest step that is clear.

    python tests/benchmarks/roundings.py [--steps DEG ...] [--winners DIR] [TASK:MODULES[:SEED] | DESIGN.json ...]

By default the designs of `WINNERS`; `--winners` keeps those that are searched, and takes the ones that are there.
A cell has the effort over that of the winner, and the number of roundings that were solved, at every margin that
was needed; or "none". The last columns are the largest step that is clear, of `compose.rounding.STEPS`, and the
processor time of one step with its audits.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nlp import hinge_sets
from topo_search import Design, read_design, read_task, search
from topo_search.compose import NotClear, audit
from topo_search.compose.rounding import STEPS, move_hinges
from topo_search.model.files import to_json, write_atomically

DESIGNS = Path(__file__).parents[1] / "designs"
WINNERS = (
    *(f"{task}:3" for task in ("push", "push-local", "push-directional", "push-exterior-60", "wall-push",
                               "window-cleaning", "survives-a-rotor")),
    *(f"ten-wrenches:3:{seed}" for seed in range(5)),
    *(f"{task}:4" for task in ("push", "push-local", "push-directional", "push-two-paths")),
    *(f"ten-wrenches:4:{seed}" for seed in range(2)),
    str(DESIGNS / "push-a70010.json"),
    str(DESIGNS / "wall-press.json"),
)  # fmt: skip
"""Tasks with their number of modules and seed, and designs with more modules."""


def winner(name: str, folder: Path) -> Design:
    """Return the best design of a task, or the design of a file."""
    if name.endswith(".json"):
        return read_design(name)
    path = folder / f"{name.replace(':', '-')}.json"
    if not path.exists():
        task, n, *seed = name.split(":")
        settings = f"modules={n}", *(f"task_seed={number}" for number in seed)
        with tempfile.TemporaryDirectory() as run:
            answer = search(read_task(task, settings), out=Path(run) / "run", workers=1)
        assert answer.design is not None
        write_atomically(path, to_json(answer.design))
    return read_design(path)


def counted(solve: Callable[..., Any], tried: list[int]) -> Callable[..., Any]:
    """Return a function that also counts its calls."""

    def count(*arguments: Any, **options: Any) -> Any:
        tried[0] += 1
        return solve(*arguments, **options)

    return count


def main() -> None:
    """Round and print, a row a winner."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=WINNERS, metavar="TASK:MODULES[:SEED]|DESIGN.json")
    parser.add_argument("--steps", type=float, nargs="+", default=[5.0, 1.0, 0.5, 0.1])
    parser.add_argument("--winners", type=Path, default=Path("winners"))
    options = parser.parse_args()
    tried = [0]
    hinge_sets.local_minima = counted(hinge_sets.local_minima, tried)
    hinge_sets.correct = counted(hinge_sets.correct, tried)  # once for each rounding that Ipopt solves
    costs = dict[float, list[float]]()
    print("| winner | tree |", *(f"{step:g} deg |" for step in options.steps), "largest clear | CPU s |")
    for name in options.names:
        design, seconds, cells = winner(name, options.winners), list[float](), list[str]()
        assert audit(design).verdict == "clear", name

        def effort(step: float, design: Design = design, seconds: list[float] = seconds) -> float | None:
            tried[0], start = 0, time.process_time()
            try:
                rounded, _ = move_hinges(design, hinge_step_deg=step)
            except NotClear:
                return None
            finally:
                seconds.append(time.process_time() - start)
            return 100 * (rounded.objective / design.objective - 1)

        for step in options.steps:
            cost = effort(step)
            cells.append(f"none, {tried[0]}" if cost is None else f"{cost:+.3f} %, {tried[0]}")
            costs.setdefault(step, []).extend([] if cost is None else [cost])
        largest = next((step for step in STEPS if effort(step) is not None), None)
        label = f"{Path(name).stem if name.endswith('.json') else name} | `{design.topology.key}`"
        told = "none" if largest is None else f"{largest:g} deg"
        cells += [told, f"{statistics.median(seconds):.1f}"]
        print(f"| {label} |", *(f"{cell} |" for cell in cells), flush=True)
    for step, found in costs.items():
        median, most = statistics.median(found), max(found)
        print(f"{step:g} deg: {len(found)} clear, median {median:+.3f} %, most {most:+.3f} %")


if __name__ == "__main__":
    main()
