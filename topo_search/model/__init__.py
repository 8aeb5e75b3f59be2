"""The nouns: frozen, picklable values that cross the borders between solver, audit and search."""

from topo_search.model.audit import (
    Audit,
    Clearance,
    Interference,
    Limit,
    Pair,
    Residual,
    Sensitivity,
    Status,
    WorstCase,
)
from topo_search.model.bad_input import BadInput, Fault
from topo_search.model.design import Design, SolverRecord
from topo_search.model.exposure import LEAST_OFFSET, Directional, Exterior, Local, needs_offset
from topo_search.model.infeasible import Infeasible
from topo_search.model.load_case import LoadCase, Wrench, ten_wrenches
from topo_search.model.module import AirflowEnvelope, Module
from topo_search.model.task import EndEffector, ResolvedTask, Search, Task, Tolerances
from topo_search.model.topology import Topology

__all__ = [
    "LEAST_OFFSET",
    "AirflowEnvelope",
    "Audit",
    "BadInput",
    "Clearance",
    "Design",
    "Directional",
    "EndEffector",
    "Exterior",
    "Fault",
    "Infeasible",
    "Interference",
    "Limit",
    "LoadCase",
    "Local",
    "Module",
    "Pair",
    "Residual",
    "ResolvedTask",
    "Search",
    "Sensitivity",
    "SolverRecord",
    "Status",
    "Task",
    "Tolerances",
    "Topology",
    "WorstCase",
    "Wrench",
    "needs_offset",
    "ten_wrenches",
]
