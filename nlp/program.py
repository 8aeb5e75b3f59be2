"""How a topology is solved for a task: as the problem stands, or with the cones that hold all airflow last."""

from __future__ import annotations

from nlp.one_stage import Program, one_stage
from nlp.two_stages import TwoStages
from topo_search.model import Exterior, ResolvedTask, Topology

TWO_STAGES_FROM = 16
"""Fewest modules for which a second try in two stages pays: of few, it makes starts that miss two to three times as
expensive, and next to none end in a design (`tests/benchmarks/staging.py`)."""


def program(task: ResolvedTask, topology: Topology) -> Program:
    """Return the program of a task and topology, ready to be solved from many starts."""
    cone = any(isinstance(asked, Exterior) for asked in task.exposure)
    if cone and task.end_effector.fixed_position is None and topology.n >= TWO_STAGES_FROM:
        return TwoStages(task, topology)
    return one_stage(task, topology)
