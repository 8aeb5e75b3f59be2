"""The nouns: frozen, picklable values that cross the borders between solver, audit and search."""

from topo_search.model.assembly import Assembly, BoltedJoint, EndEffectorSheet, FreeConnector, Obstacle, Rod
from topo_search.model.audit import (
    AllowedContact,
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
from topo_search.model.design import Design, Mount, ShorterRod, SolverRecord
from topo_search.model.end_effector import EndEffector
from topo_search.model.exposure import (
    LEAST_OFFSET,
    Allowed,
    AnyExposure,
    Directional,
    Exterior,
    Local,
    Plane,
    needs_offset,
    segment_of,
)
from topo_search.model.flight import CaseFlight, Flight, JointLoad, RotorsOut
from topo_search.model.infeasible import Infeasible, Shortfall
from topo_search.model.load_case import LoadCase, Wrench, ten_wrenches
from topo_search.model.module import AirflowEnvelope, Module
from topo_search.model.proof import CheckedChunk, Chunk, Proof
from topo_search.model.relaxation import Relaxation, Relaxed
from topo_search.model.search import Search
from topo_search.model.task import ResolvedTask, Task, Tolerances
from topo_search.model.topology import Topology

__all__ = [
    "LEAST_OFFSET",
    "AirflowEnvelope",
    "Allowed",
    "AllowedContact",
    "AnyExposure",
    "Assembly",
    "Audit",
    "BadInput",
    "BoltedJoint",
    "CaseFlight",
    "CheckedChunk",
    "Chunk",
    "Clearance",
    "Design",
    "Directional",
    "EndEffector",
    "EndEffectorSheet",
    "Exterior",
    "Fault",
    "Flight",
    "FreeConnector",
    "Infeasible",
    "Interference",
    "JointLoad",
    "Limit",
    "LoadCase",
    "Local",
    "Module",
    "Mount",
    "Obstacle",
    "Pair",
    "Plane",
    "Proof",
    "Relaxation",
    "Relaxed",
    "Residual",
    "ResolvedTask",
    "Rod",
    "RotorsOut",
    "Search",
    "Sensitivity",
    "ShorterRod",
    "Shortfall",
    "SolverRecord",
    "Status",
    "Task",
    "Tolerances",
    "Topology",
    "WorstCase",
    "Wrench",
    "needs_offset",
    "segment_of",
    "ten_wrenches",
]
