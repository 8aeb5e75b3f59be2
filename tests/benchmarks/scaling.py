"""Build and solve from the same starts: the page as one graph against the assembled program, in one run.

    python tests/benchmarks/scaling.py [--sizes 5 7 10 20] [--topologies N] [--starts N] [--time-graph-up-to N]

The paper's ten wrenches without body clearance (its literal problem) on uniformly drawn trees; both programs get
the same starts. Run it with OMP_NUM_THREADS=1 for times of one core; ratios compare medians within this run.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass, field

from nlp.assembled import AssembledProgram
from nlp.evaluate import violations, worst
from nlp.finish import finish
from nlp.graph import GraphProgram
from nlp.point import Point
from nlp.program import Program
from nlp.starts import draw, generator
from topo_search.model import ResolvedTask, Topology
from topo_search.model.files import read_task
from topo_search.topologies import sample


@dataclass
class Record:
    """One kind of program at one size."""

    builds: list[float] = field(default_factory=list)
    solves: list[float] = field(default_factory=list)
    solved: set[str] = field(default_factory=set)
    """Keys of the topologies with a design."""

    def measure(
        self, kind: type[GraphProgram | AssembledProgram], task: ResolvedTask, topology: Topology
    ) -> Program:
        """Build a program."""
        began = time.perf_counter()
        program = kind(task, topology)
        self.builds.append(time.perf_counter() - began)
        return program

    def solve(self, program: Program, start: Point) -> None:
        """Solve from a start."""
        began = time.perf_counter()
        point = finish(program.solve(start).point)
        self.solves.append(time.perf_counter() - began)
        if worst(violations(point)).met:
            self.solved.add(start.topology.key)

    def row(self) -> tuple[float, float, int]:
        """Return median build and solve times and the number of solved topologies."""
        return statistics.median(self.builds), statistics.median(self.solves), len(self.solved)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[5, 7, 10, 20])
    parser.add_argument("--topologies", type=int, default=5)
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--time-graph-up-to", type=int, default=20, help="largest size that the graph is built for")
    arguments = parser.parse_args()
    header = f"{'n':>3} {'program':10}{'build s':>9}{'draw s':>8}{'solve s':>9}{'solved':>8}"
    print(f"{header}   graph / assembled, build and solve")
    for n in arguments.sizes:
        task = read_task("ten-wrenches", (f"modules={n}", "search.body_clearance=false")).resolve(n)
        kinds: dict[str, type[GraphProgram | AssembledProgram]] = {"assembled": AssembledProgram}
        if n <= arguments.time_graph_up_to:
            kinds["graph"] = GraphProgram
        records = {name: Record() for name in kinds}
        draws: list[float] = []
        topologies = sample(n, arguments.topologies, 0)
        for topology in topologies:
            programs = {name: records[name].measure(kind, task, topology) for name, kind in kinds.items()}
            for index in range(arguments.starts):
                began = time.perf_counter()
                start = draw(task, topology, generator(task, topology, index, 0))
                draws.append(time.perf_counter() - began)
                for name, program in programs.items():
                    records[name].solve(program, start)
        rows = {name: record.row() for name, record in records.items()}
        for name, (build, solve, solved) in rows.items():
            ratio = ""
            if name == "graph":
                ratio = f"{(build + solve) / sum(rows['assembled'][:2]):.1f}"
            counts = f"{solved}/{len(topologies)}"
            print(
                f"{n:>3} {name:10}{build:>9.3f}{statistics.median(draws):>8.3f}{solve:>9.3f}{counts:>8}   {ratio}"
            )


if __name__ == "__main__":
    main()
