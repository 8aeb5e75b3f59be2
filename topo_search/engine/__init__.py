"""The search engine: solves candidates in worker processes and hands their outcomes on, storing nothing."""

from topo_search.engine.dask_connection import Certificates
from topo_search.engine.dask_workers import DaskWorkers, computing_versions
from topo_search.engine.jobs import (
    AuditDesign,
    Backends,
    Engine,
    Failed,
    Job,
    Outcome,
    Solve,
    WorkersLost,
    audit_deadline,
    merge,
    record_of,
    rounds,
    scaled_violation,
    solve_deadline,
    solve_jobs,
)
from topo_search.engine.space import Listed, Space
from topo_search.engine.strategy import CandidateSolver, Proposal, Scored, TimeUp, exhaustive_search, may_beat
from topo_search.engine.workers import CallingProcess, Workers

__all__ = [
    "AuditDesign",
    "Backends",
    "CallingProcess",
    "CandidateSolver",
    "Certificates",
    "DaskWorkers",
    "Engine",
    "Failed",
    "Job",
    "Listed",
    "Outcome",
    "Proposal",
    "Scored",
    "Solve",
    "Space",
    "TimeUp",
    "Workers",
    "WorkersLost",
    "audit_deadline",
    "computing_versions",
    "exhaustive_search",
    "may_beat",
    "merge",
    "record_of",
    "rounds",
    "scaled_violation",
    "solve_deadline",
    "solve_jobs",
]
