"""How far the solver's smooth constraints are off the exact clearances, and the margin that this asks for.

    PYTHONPATH=tests python tests/benchmarks/smooth_error.py [--margin M] [--sizes 4 5] [--designs N] [--starts N]

The solver keeps clearances by a log-sum-exp over clamped candidates, which is close to the distance but not below
it by proof; the margin has to cover the difference. With the margin 0 (the default here) the designs that Ipopt
calls solved end where the smooth constraints say "touching", and the audit says how far the bodies really are
apart: the slack. Negative slack is what a margin is for. All shipped examples, each with and without body
clearance, on uniformly drawn trees.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from nlp_cases import as_design

from nlp.assembled import AssembledProgram
from nlp.evaluation import correct
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, ResolvedTask
from topo_search.model.files import examples, read_task
from topo_search.topologies import sample
from verify import audit
from verify.certificate import FLOOR

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
ACTIVE = 1e-3
"""Clearances within this of the margin are held there by their constraint [m]."""
SHARES = (0.0, 0.001, 0.01, 0.1, 0.5, 0.9)
KINDS = ("airflow", "separation", "exclusion", "local", "directional", "exterior")
"""The clearances that the solver keeps."""


def tasks(n: int, margin: float) -> Iterator[ResolvedTask]:
    """Yield every shipped example for n modules, with and without body clearance."""
    for name in examples():
        for more in ((), ("search.body_clearance=false",)):
            yield read_task(name, (f"modules={n}", f"search.margin={margin!r}", *more)).resolve(n)


def designs(sizes: Sequence[int], margin: float, starts: int) -> Iterator[Design]:
    """Yield what Ipopt calls solved, tree by tree, for as long as it is asked to; tasks and sizes take turns."""
    for draws in itertools.count():
        for n in sizes:
            (topology,) = sample(n, 1, draws)
            for task in tasks(n, margin):
                ready = AssembledProgram(task, topology)
                for start in range(starts):
                    result = ready.solve(draw(task, topology, generator(task, topology, start, 0)))
                    if result.status in SOLVED:
                        yield as_design(correct(result.point))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--margin", type=float, default=0.0, help="margin asked of the solver [m]")
    parser.add_argument("--sizes", type=int, nargs="+", default=[4, 5])
    parser.add_argument("--designs", type=int, default=1000)
    parser.add_argument("--starts", type=int, default=4, help="starts of each task and tree")
    arguments = parser.parse_args()
    slack: dict[str, list[float]] = defaultdict(list)
    least: list[float] = []
    verdicts: Counter[str] = Counter()
    floor = 0.0
    for design in itertools.islice(designs(arguments.sizes, arguments.margin, arguments.starts), arguments.designs):
        floor = max(floor, FLOOR * design.task.module.arm_length)
        found = audit(design)
        verdicts[str(found.verdict)] += 1
        gaps = [(pair.kind, pair.analytic_m - arguments.margin) for pair in found.pairs if pair.kind in KINDS]
        least.append(min(gap for _, gap in gaps))
        for kind, gap in gaps:
            if abs(gap) <= ACTIVE:
                slack[kind].append(gap)
    print(f"{arguments.designs} designs with the margin {arguments.margin:g} m")
    print(f"their audits: {', '.join(f'{k} {verdict}' for verdict, k in verdicts.most_common())}")
    head = "".join(f"{f'{100 * share:g} %':>10}" for share in SHARES)
    print(f"{'slack beyond the margin [m]':28}{'number':>8}{head}")
    for kind, values in (*((kind, slack[kind]) for kind in KINDS), ("least of a design", least)):
        if values:
            row = "".join(f"{value:>10.1e}" for value in np.quantile(values, SHARES))
            print(f"{kind:28}{len(values):>8}{row}")
    print(f"the margin falls short by {max(0.0, -min(least)):.1e} m at most; the audit's floor is {floor:.1e} m")


if __name__ == "__main__":
    main()
