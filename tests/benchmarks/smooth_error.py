"""Difference between the solver's smooth constraints and exact clearances, and the margin that covers it.

    PYTHONPATH=tests python tests/benchmarks/smooth_error.py [--margin M] [--sizes 4 5] [--designs N] [--starts N]

The solver's clearances are log-sum-exps over clamped candidates, which are close to the distance but not proven to
be below it; the margin has to cover the difference. With a margin of 0 (the default here) bodies of solved designs
touch by the smooth constraints, and the audit measures their actual clearance: the slack. The margin has to exceed
the largest negative slack. All shipped examples are solved on uniformly drawn trees, with and without body
clearance.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from nlp_cases import as_design

from nlp.evaluation import correct
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, ResolvedTask
from topo_search.model.task_file import examples, read_task
from topo_search.topologies import sample
from verify import audit
from verify.certificate import FLOOR

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
ACTIVE = 1e-3
"""Clearances this close to the margin count as active [m]."""
SHARES = (0.0, 0.001, 0.01, 0.1, 0.5, 0.9)
KINDS = ("airflow", "separation", "exclusion", "local", "directional", "exterior")
"""Kinds of clearances with a constraint in the solver."""


def tasks(n: int, margin: float) -> Iterator[ResolvedTask]:
    """Yield every shipped example for n modules, with and without body clearance."""
    for name in examples():
        for settings in ((), ("search.body_clearance=false",)):
            yield read_task(name, (f"modules={n}", f"search.margin={margin!r}", *settings)).resolve(n)


def designs(sizes: Sequence[int], margin: float, starts: int) -> Iterator[Design]:
    """Yield solved designs without end, tree by tree; tasks and sizes alternate."""
    for draws in itertools.count():
        for n in sizes:
            (topology,) = sample(n, 1, draws)
            for task in tasks(n, margin):
                program = AssembledProgram(task, topology)
                for start in range(starts):
                    result = program.solve(draw(task, topology, generator(task, topology, start, 0)))
                    if result.status in SOLVED:
                        yield as_design(correct(result.point))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--margin", type=float, default=0.0, help="the solver's margin [m]")
    parser.add_argument("--sizes", type=int, nargs="+", default=[4, 5])
    parser.add_argument("--designs", type=int, default=1000)
    parser.add_argument("--starts", type=int, default=4, help="starts per task and tree")
    arguments = parser.parse_args()
    slack: dict[str, list[float]] = defaultdict(list)
    least: list[float] = []
    verdicts: Counter[str] = Counter()
    floor = 0.0
    for design in itertools.islice(designs(arguments.sizes, arguments.margin, arguments.starts), arguments.designs):
        floor = max(floor, FLOOR * design.task.module.arm_length)
        audited = audit(design)
        verdicts[str(audited.verdict)] += 1
        gaps = [(pair.kind, pair.analytic_m - arguments.margin) for pair in audited.pairs if pair.kind in KINDS]
        least.append(min(gap for _, gap in gaps))
        for kind, gap in gaps:
            if abs(gap) <= ACTIVE:
                slack[kind].append(gap)
    print(f"{arguments.designs} designs with the margin {arguments.margin:g} m")
    print(f"their audits: {', '.join(f'{k} {verdict}' for verdict, k in verdicts.most_common())}")
    head = "".join(f"{f'{100 * share:g} %':>10}" for share in SHARES)
    print(f"{'slack beyond the margin [m]':28}{'number':>8}{head}")
    for kind, values in (*((kind, slack[kind]) for kind in KINDS), ("smallest per design", least)):
        if values:
            row = "".join(f"{value:>10.1e}" for value in np.quantile(values, SHARES))
            print(f"{kind:28}{len(values):>8}{row}")
    print(f"the margin falls short by {max(0.0, -min(least)):.1e} m at most; the audit's floor is {floor:.1e} m")


if __name__ == "__main__":
    main()
