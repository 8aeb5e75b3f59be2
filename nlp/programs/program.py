"""The nonlinear program of one task and topology, made ready once and solved from many starts."""

from __future__ import annotations

from typing import Protocol

from nlp.numbers.point import Point
from nlp.own import OwnConstraints
from nlp.programs.graph import GraphProgram
from nlp.programs.ipopt import IpoptResult
from topo_search.model import ResolvedTask, Topology

GRAPH_UP_TO = 7
"""Most modules for which building the graph pays; `tests/benchmarks/performance.py` measures it."""


class Program(Protocol):
    """A nonlinear program, ready to be solved from any start."""

    def solve(self, start: Point) -> IpoptResult:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""


def program(task: ResolvedTask, topology: Topology, own: OwnConstraints = ()) -> Program:
    """Return the program that is faster for the topology's size; both state the problem and own constraints."""
    if topology.n <= GRAPH_UP_TO:
        return GraphProgram(task, topology, own)
    from nlp.assembled import AssembledProgram  # compiled code, which small platforms need not load

    return AssembledProgram(task, topology, own)
