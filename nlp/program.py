"""The nonlinear program of one task and topology, made ready once and solved from many starts."""

from __future__ import annotations

from typing import Protocol

from nlp.graph import GraphProgram
from nlp.ipopt import Answer
from nlp.point import Point
from topo_search.model import ResolvedTask, Topology

GRAPH_UP_TO = 7
"""Most modules for which building the graph of the page pays; `tests/benchmarks/performance.py` measures it."""


class Program(Protocol):
    """A nonlinear program, ready to be solved from any start."""

    def solve(self, start: Point) -> Answer:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""


def program(task: ResolvedTask, topology: Topology) -> Program:
    """Return the program that is the faster for the topology's size; both state the same problem."""
    if topology.n <= GRAPH_UP_TO:
        return GraphProgram(task, topology)
    from nlp.assembled import AssembledProgram  # compiled code, which small platforms need not load

    return AssembledProgram(task, topology)
