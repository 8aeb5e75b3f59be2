"""A problem without physics for tests of the search: values follow from keys, and keys can be told to misbehave.

Environment variables reach the worker processes. TOY_LOG names a file that gets a line `key margin pid` for every
solve, and then the keys of the designs that were to be carried over, TOY_AUDIT_LOG one that gets the key for every
audit; TOY_SLEEP is the time a solve takes [s]. TOY_SEGFAULT, TOY_HANG, TOY_RAISE, TOY_MEMORY, TOY_NONE and
TOY_VIOLATED name keys (`*` for all) that crash, never end, raise, run out of memory, are infeasible, or fail their
audit while the margin is under TOY_MARGIN. TOY_LOSS is how much clearance
errors of building cost [m]. Those of TOY_OPTIMAL meet the bound with the usual margin.
"""

import argparse
import hashlib
import importlib
import math
import os
import signal
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from older import older_task

from topo_search.engine import Backends, CallingProcess, DaskWorkers, Engine, Job, Workers
from topo_search.engine.strategy import WAIT
from topo_search.model import (
    Audit,
    Design,
    Geometry,
    Infeasible,
    LoadCase,
    ResolvedTask,
    Sensitivity,
    Shortfall,
    SolverRecord,
    Topology,
    WorstCase,
    Wrench,
)
from topo_search.study import DEFAULT_ROUND, Request, Row, SilentObserver, UserInputs, run, solve_single
from topo_search.study.optima import keep_optima

BOUND = 1.0
"""Every objective lies above."""


def toy_task(modules=3):
    return older_task(name="toy", modules=modules, load_cases=(LoadCase(com=Wrench(force=(0.0, 0.0, 1.0))),))


def _told(variable: str, key: str) -> bool:
    return key in (names := os.environ.get(variable, "").split(",")) or "*" in names


def value(key: str, start: int, seed: int, margin: float) -> float:
    """The objective of one start; a larger margin costs a little."""
    if _told("TOY_OPTIMAL", key):
        return BOUND + margin - 1e-4
    drawn = hashlib.sha256(f"{key} {start} {seed}".encode()).digest()[0] / 256
    return BOUND + 1 + drawn + 100 * margin


def infeasible(topology: Topology | None, status: str = "infeasible", **fields) -> Infeasible:
    """A tree without a design, or all of them: a torque is missed unless other fields say what is."""
    missed = {"worst_constraint": "load case 0, torque", "violation": 1.0, "unit": "N m", "message": "", **fields}
    return Infeasible(topology=topology, topology_key=topology and topology.key, status=status, **missed)


def solve(job: Job) -> Design | Infeasible:
    task, topology, starts, seed, near = job.task, job.topology, job.starts, job.seed, job.near
    key, margin = topology.key, task.search.margin
    if log := os.environ.get("TOY_LOG"):
        with Path(log).open("a") as stream:
            print(key, f"{margin:g}", os.getpid(), *(design.topology.key for design in near), file=stream)
    if _told("TOY_SEGFAULT", key):
        os.kill(os.getpid(), signal.SIGSEGV)
    if _told("TOY_MEMORY", key):
        raise MemoryError
    if _told("TOY_RAISE", key):
        raise ValueError("`toy` must hold, but got no toy")
    while _told("TOY_HANG", key):
        time.sleep(0.1)
    time.sleep(float(os.environ.get("TOY_SLEEP", "0")))
    feasible = not _told("TOY_NONE", key)
    platform = {
        "task": task,
        "topology": topology,
        "topology_key": key,
        "root_orientation_rad": (0.0, 0.0, 0.0),
        "hinge_angles_rad": (0.0,) * (topology.n - 1),
        "end_effector_m": (0.0, 0.0, 1.0),
    }
    starts = starts or range(-len(near), 0)  # designs alone stand for starts, beside others they bring nothing
    best = min(starts, key=lambda s: (value(key, s, seed, margin), s))
    record = SolverRecord(
        status="Solve_Succeeded",
        iterations=1,
        seconds=0.5 * len(starts),
        seed=seed,
        start=best,
        starts=len(starts),
        starts_feasible=len(starts) if feasible else 0,
        objectives=tuple(value(key, s, seed, margin) for s in starts) if feasible else (),
        versions={},
    )
    if not feasible:
        missed = {
            s: Shortfall(
                constraint=f"load case {s % 5}, torque", starts=1, violation=value(key, s, seed, margin), unit="N m"
            )
            for s in starts
        }
        name, amount = missed[best].constraint, missed[best].violation
        missed_most = {"worst_constraint": name, "violation": amount, "closest": Geometry(**platform)}
        return infeasible(topology, **missed_most).with_starts(missed.values(), record)
    objective = value(key, best, seed, margin)
    input_ = math.sqrt(objective / (4 * topology.n * sum(case.weight for case in task.load_cases)))
    return Design(
        **platform,
        rotor_speeds_squared=((input_,) * (4 * topology.n),) * len(task.load_cases),
        objective=objective,
        lower_bound=BOUND,
        gap=None,
        solver=record.model_dump(mode="json"),
    )


def audit(design: Design) -> Audit:
    key = design.topology.key
    if log := os.environ.get("TOY_AUDIT_LOG"):
        with Path(log).open("a") as stream:
            stream.write(f"{key}\n")
    if _told("TOY_AUDIT_SEGFAULT", key):
        os.kill(os.getpid(), signal.SIGSEGV)
    left = design.task.search.margin - float(os.environ.get("TOY_LOSS", "0"))
    pair = {"kind": "airflow", "a": 0, "b": 1, "segment": None, "status": "clear" if left >= 0 else "undecided"}
    worst = WorstCase(**pair, lower_m=left, attained_m=left, factor=None)
    errors = Sensitivity(hinge_angle_deg=None, position_m=None, envelope_m=None, tolerances=worst)
    short = design.task.search.margin < float(os.environ.get("TOY_MARGIN", "inf"))
    return Audit(
        verdict="violated" if _told("TOY_VIOLATED", key) and short else worst.status,
        sensitivity=errors if "TOY_LOSS" in os.environ else None,
        pairs=(),
        residuals=(),
        assembly={},
        allowed_contacts=(),
        versions={},
        seconds=0.0,
    )


def lower_bound(task: ResolvedTask) -> float:
    return BOUND


def prove_impossible(task: ResolvedTask) -> Infeasible | None:
    if not _told("TOY_IMPOSSIBLE", str(task.n)):
        return None
    why = {
        "worst_constraint": "load case 0, force",
        "unit": "N",
        "message": "three modules cannot lift what is asked",
    }
    return infeasible(None, "impossible", **why)


def local_optima(job: Job, max_effort: float) -> list[Design]:
    """Each start is an optimum of its own."""
    optima = [*job.near, *(solve(replace(job, starts=range(s, s + 1), near=())) for s in job.starts)]
    return sorted((design for design in optima if design.objective <= max_effort), key=lambda one: one.objective)


BACKENDS = Backends(
    solve=solve, audit=audit, lower_bound=lower_bound, prove_impossible=prove_impossible, local_optima=local_optima
)


class InProcess(CallingProcess):
    """Stands in for the worker processes where they are not what is tested."""

    def __init__(self, count):
        self.count = count


class Hasty(Engine):
    """An engine that takes a job for hung after a few seconds."""

    def __init__(self, engine, seconds):
        self.engine, self.seconds = engine, seconds

    def run(self, function, jobs, *, deadline, until=math.inf):
        return self.engine.run(function, jobs, deadline=lambda _: self.seconds, until=until)


def toy_run(
    path,
    *,
    modules=3,
    task=None,
    symmetry="c2",
    starts=2,
    seed=0,
    strategy="exhaustive",
    sampler="moves",
    trials=None,
    prune=False,
    round_size=DEFAULT_ROUND,
    workers=None,
    engine=None,
    observer=None,
    backends=BACKENDS,
    listed=None,
    keep_within=None,
    **options,
):
    """Run the toy problem: on an engine, in worker processes if their number is given, or in this process."""
    asked = task or toy_task(modules)
    own = UserInputs(topologies=listed)
    request = Request(asked, symmetry, starts, seed, strategy, sampler, trials, prune, round_size, user_inputs=own)
    if keep_within is not None:
        options["after_size"] = [partial(keep_optima, percent=keep_within)]
    place = Workers(workers) if workers else InProcess(1)
    with nullcontext(engine) if engine else place as engine:
        return run(request, Path(path), backends, engine=engine, observer=observer or SilentObserver(), **options)


def toy_solved(key, task=None, starts=1):
    """Solve one tree as `solve` does, in this process."""
    topology, engine = Topology.from_key(key), CallingProcess()
    resolved = (task or toy_task(topology.n)).resolve(topology.n)
    options = {"starts": starts, "round_size": starts, "seed": 0, "time_limit": None, "engine": engine}
    return solve_single(resolved, topology, BACKENDS, **options, progress=lambda _: None)


def follow(strategy, solver):
    """Let a solver answer what a strategy proposes, each result when the strategy needs it."""
    stage = None
    while (proposal := strategy.ask()) is not None:
        if proposal == WAIT:
            strategy.tell(*solver.results(1))
            continue
        if strategy.stage is not stage:
            stage = strategy.stage
            solver.begin_stage(*stage)
        solver.submit(proposal)


def toy_row(key, *, objective, gap):
    return Row(
        key=key, modules=3, orbit=1, status="feasible", asked=1, lower_bound=BOUND, objective=objective, gap=gap
    )


def solved_keys(log) -> list[str]:
    return [line.split()[0] for line in Path(log).read_text().splitlines()]


COMMAND = """
import toy_problem
from topo_search import compose
from topo_search.__main__ import main

compose.binding.BACKENDS = toy_problem.BACKENDS
compose.binding.Workers = toy_problem.InProcess
main()
"""
"""The command `topo-search` on the toy problem, in one process beside the one that watches it."""


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("path")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--modules", type=int, default=3)
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--strategy", default="exhaustive")
    parser.add_argument("--trials", type=int)
    parser.add_argument("--dask")
    parser.add_argument("--deadline", type=float)
    given = vars(parser.parse_args())
    address, deadline, count = (given.pop(name) for name in ("dask", "deadline", "workers"))
    with DaskWorkers(address) if address else Workers(count) as engine:
        answer = toy_run(**given, engine=Hasty(engine, deadline) if deadline else engine)
    sys.exit(answer.exit_status)


if __name__ == "__main__":
    importlib.import_module("toy_problem").main()  # functions of __main__ are nowhere else
