"""The search engine: search strategies, and workers that run jobs in other processes; it stores nothing."""

from topo_search.engine.dask_workers import DaskWorkers
from topo_search.engine.strategy import (
    WAIT,
    Candidates,
    ExhaustiveSearch,
    ListedCandidates,
    Proposal,
    Stage,
    Strategy,
    Tried,
    may_beat,
)
from topo_search.engine.workers import (
    AuditDesign,
    Backends,
    CallingProcess,
    Engine,
    Failed,
    Job,
    Outcome,
    Workers,
    WorkersLost,
    audit_deadline,
    audit_job,
    merge,
    record_of,
    scaled_violation,
    solve_deadline,
    start_ranges,
)
