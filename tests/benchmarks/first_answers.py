"""First answers of tasks as people write them (`tests/tasks`): with the defaults of flying tasks and without.

    PYTHONPATH=tests python tests/benchmarks/first_answers.py [TASK ...] [--modules N] [--without]

J is the control effort, its excess that over the best design without the defaults (`--without`); times are of the
process and its children, with the solver compiled.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
from collections.abc import Iterator
from pathlib import Path

from topo_search import Answer, Task, read_task, search
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import Options

TASKS = Path(__file__).parents[1] / "tasks"


def seconds() -> float:
    """Return the processor time used so far [s]."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(time.ru_utime + time.ru_stime for time in used)


def timed(task: Task) -> tuple[Answer, float]:
    """Search a task on one worker; return the answer and the processor time [s]."""
    start = seconds()
    with tempfile.TemporaryDirectory() as folder:
        answer = search(task, out=Path(folder) / "run", workers=1)
    return answer, seconds() - start


def rows(options: argparse.Namespace) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each task."""
    for path in sorted(TASKS.glob("*.toml")):
        if options.tasks and path.stem not in options.tasks:
            continue
        settings = (f"modules={options.modules}",)
        answer, spent = timed(read_task(path, settings))
        bare, bare_spent = None, 0.0
        if options.without:
            bare, bare_spent = timed(read_task(path, (*settings, "flight.defaults=false")))
        excess = ratio = ""
        if bare is not None and bare.best is not None and answer.best is not None:
            excess = f"{100 * (answer.best.objective / bare.best.objective - 1):+.0f} %"
            ratio = f"{spent / bare_spent:.1f}"
        missed = ", ".join(entry.words for entry in answer.fragile)
        flown = "" if answer.design is None else fly_all(answer.design, Options()).result.outcome
        best = "none" if answer.best is None else f"{answer.best.key} {answer.best.objective:.3e}"
        yield path.stem, best, excess, missed or "held", flown, f"{spent:.0f} s", ratio


def main() -> None:
    """Print a row a task as it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", metavar="TASK")
    parser.add_argument("--modules", type=int, default=3)
    parser.add_argument("--without", action="store_true")
    print("| task | best, J [rad^4/s^4] | effort over none | defaults | flown | CPU | CPU over none |")
    print("|---|---|---|---|---|---|---|")
    for cells in rows(parser.parse_args()):
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
