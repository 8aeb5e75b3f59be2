"""The search engine: search strategies, and workers that run jobs in other processes; it stores nothing."""

from topo_search.engine.dask_workers import DaskWorkers
from topo_search.engine.strategy import Candidates, Proposal, Stage, Strategy, Tried
from topo_search.engine.workers import Backends, CallingProcess, Engine, Failed, Job, Outcome, Workers, WorkersLost
