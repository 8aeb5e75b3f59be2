"""The nouns: frozen, picklable values that cross the borders between solver, audit and search."""

from topo_search.model.audit import (
    AllowedContact,
    Assembly,
    Audit,
    BoltedJoint,
    Clearance,
    EndEffectorSheet,
    FreeConnector,
    Interference,
    Limit,
    Obstacle,
    Residual,
    Rod,
    Sensitivity,
    Status,
    WorstCase,
)
from topo_search.model.design import Design, Geometry, Infeasible, Relaxed, ShorterRod, Shortfall, SolverRecord
from topo_search.model.exposure import LEAST_OFFSET, AnyExposure, needs_offset, segment_of
from topo_search.model.flight import CaseFlight, CasePower, Flight, JointLoad, RotorsOut
from topo_search.model.load_case import LoadCase, Wrench, ten_wrenches
from topo_search.model.module import AirflowEnvelope, EndEffector, Module, Mount
from topo_search.model.proof import CheckedChunk, Chunk, Proof
from topo_search.model.search import Search
from topo_search.model.task import ResolvedTask, Task, Tolerances
from topo_search.model.topology import Topology
from topo_search.model.value import BadInput, Fault
