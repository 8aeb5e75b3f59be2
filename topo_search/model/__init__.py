"""The nouns: frozen, picklable values that cross the borders between solver, audit and search."""

from topo_search.model.air import SpeedEnvelope
from topo_search.model.airflow import AirflowEnvelope
from topo_search.model.arrays import PORT_DIRECTIONS, Array, Flags, Indices, read_only
from topo_search.model.assembly import Assembly, BoltedJoint, EndEffectorSheet, ShorterRod
from topo_search.model.audit import AllowedContact, Audit, Interference, Residual
from topo_search.model.clearance import Clearance, Status
from topo_search.model.corners import CorneredTask
from topo_search.model.design import Design, Geometry, Infeasible, Shortfall, SolverRecord
from topo_search.model.end_effector import CountedRod, EndEffector, Mount
from topo_search.model.exposure import LEAST_OFFSET, AnyExposure, needs_offset, segment_of
from topo_search.model.flight import CaseFlight, CasePower, Flight, JointLoad, RotorsOut
from topo_search.model.kinds import Vector
from topo_search.model.largest_value import LargestValue, objective_of
from topo_search.model.load_case import LoadCase, Wrench, ten_wrenches
from topo_search.model.mesh_file import MeshExcess
from topo_search.model.module import Module
from topo_search.model.objective import LEAST_EFFORT, Objective
from topo_search.model.proof import CheckedChunk, Chunk, Proof
from topo_search.model.relaxed import Relaxed
from topo_search.model.search import Search
from topo_search.model.sensitivity import Limit, Sensitivity, Tolerances, WorstCase
from topo_search.model.task import ResolvedTask, Task
from topo_search.model.topology import Topology
from topo_search.model.value import BadInput, Fault, Value, as_bad_input
from topo_search.model.vehicle import Capability
