"""Where solver, audit and search meet: the Python interface, and what the command line calls.

These functions start worker processes: in a script, call them under `if __name__ == "__main__":`.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import nlp
import verify
from topo_search.engine import (
    AuditDesign,
    Backends,
    Certificates,
    DaskWorkers,
    Failed,
    Outcome,
    Workers,
    audit_deadline,
    computing_versions,
)
from topo_search.limits import CANDIDATES, GAPS, MODULES, STARTS, WORKERS
from topo_search.model import Audit, BadInput, Design, Fault, Infeasible, ResolvedTask, Status, Task, Topology
from topo_search.model.files import read_json, read_task, write_atomically
from topo_search.model.proof import Problem
from topo_search.own import AnySampler, handed_in, starting_points, stated
from topo_search.protocols import OwnConstraint
from topo_search.study import (
    DEFAULT_ROUND,
    REPORT,
    Answer,
    Checked,
    Observer,
    Request,
    RunFolder,
    Silent,
    Solved,
    StrategyName,
    run,
    solve_single,
)
from topo_search.study import check as check_run
from topo_search.study import prove as prove_run
from topo_search.study.proving import refuse_unprovable
from topo_search.topologies import OwnTopology, Symmetry, improper_isometry


def _solve(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
) -> Design | Infeasible:
    """Solve one topology, and choose where the rod of a design's end-effector is bolted."""
    outcome = nlp.solve(task, topology, starts=starts, seed=seed, near=near, constraints=constraints)
    if isinstance(outcome, Design):
        return outcome.model_copy(update={"mount": verify.choose_mount(outcome)})
    return outcome


def _audit(design: Design, *, constraints: Sequence[OwnConstraint]) -> Audit:
    """Audit a design, and evaluate own constraints at the poses that the audit derives."""
    from verify.kinematics import platform

    audited, at = verify.audit(design), platform(design)
    found = nlp.check_stated(constraints, design, orientations=at.poses.R, centres=at.o, end_effector=at.p_e)
    here = {one.name for one in found}
    missed = any(one.status == "missed" for one in found)
    return audited.model_copy(
        update={
            "stated": (*found, *(one for one in audited.stated if one.name not in here)),
            "verdict": Status.worst([audited.verdict, Status.VIOLATED if missed else Status.CLEAR]),
        }
    )


def _backends(constraints: Sequence[OwnConstraint]) -> Backends:
    """Return solver, audit and bounds; own constraints are the business of the first two."""
    if not constraints:
        return BACKENDS
    given = tuple(constraints)
    return replace(BACKENDS, solve=partial(_solve, constraints=given), audit=partial(_audit, constraints=given))


BACKENDS = Backends(
    solve=_solve, audit=verify.audit, lower_bound=nlp.lower_bound, prove_impossible=nlp.prove_impossible
)

DEFAULT_TRIALS = 512
"""Candidates that are proposed when not all are solved and nobody says otherwise."""

DEFAULT_GAP = 0.003
"""To which a tree is proven that cannot be excluded."""

RUNS = Path("runs")
"""Where runs go unless another folder is named."""


def search(
    task: Task | str | Path,
    *,
    out: str | Path | None = None,
    symmetry: Symmetry = "task",
    strategy: StrategyName = "exhaustive",
    sampler: AnySampler = "moves",
    trials: int | None = DEFAULT_TRIALS,
    round_size: int = DEFAULT_ROUND,
    prune: bool = False,
    starts: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    dask: str | None = None,
    dask_tls: Certificates | None = None,
    time_limit: float = math.inf,
    near: Iterable[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
    topologies: Iterable[OwnTopology] | None = None,
    prove: float | None = None,
    observer: Observer | None = None,
) -> Answer:
    """Search the topologies for the best design of a task, audit the best ones and write a run folder.

    Args:
        task: a task, its file, or the name of a shipped example.
        out: the run's folder; default: `runs/NAME-HASH`.
        symmetry: symmetries under which trees count as one candidate.
        strategy: `exhaustive` solves every candidate; `optuna` those that a sampler proposes, round by round.
        sampler: sampling algorithm: `moves` on the best trees, `tpe`, `nsga2` or `random`; or your own: an
            `OwnSampler`, a function that makes any Optuna sampler or a `TopologySampler` for a seed, or a
            `TopologySampler` without state.
        trials: number of candidates to propose; None: all.
        round_size: proposals per round; each round learns from the rounds before. Larger rounds keep more workers
            busy but learn more slowly.
        prune: skip candidates that the lower bound proves no better than the best design so far.
        starts: starts per candidate, or per finalist if not all are proposed; default: by the number of modules.
        seed: random seed of starts and proposals.
        workers: worker processes; default: the cores available. Results do not depend on it.
        dask: address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT, whose workers replace local
            processes. Plain tcp is not authenticated, and results are unpickled.
        dask_tls: certificates for tls; default: those of Dask's own configuration.
        time_limit: stop solving, or proving, after this time [s].
        near: designs of any trees; each adds one start to every candidate.
        constraints: your own constraints on designs. They are evaluated, not certified; unless they are declared
            `invariant`, every rooted tree is a candidate.
        topologies: the only candidates: trees, keys, or graphs as of `Topology.graph`. Each is solved as given.
        prove: relative gap to which branch and bound then proves that no tree is better, as `prove` does.
        observer: receives progress.

    Raises:
        BadInput: the task, folder, address, a certificate or your own code is invalid, or there are too many
            candidates to solve them all.
        ValueError: starts, trials, round_size or workers are out of range (`limits`), or strategy or sampler is
            unknown.
        WorkersLost: workers do not start or return, or the Dask scheduler does not answer; results are kept.
    """
    asked = _task(task)
    handed = handed_in(
        asked,
        near=near,
        constraints=constraints,
        topologies=topologies,
        sampler=sampler,
        elsewhere=dask is not None,
    )
    request = Request(
        asked,
        symmetry,
        nlp.default_starts(asked) if starts is None else starts,
        seed,
        strategy,
        handed.sampler,
        trials if strategy == "optuna" else None,
        prune and strategy == "exhaustive",
        round_size,
        own=handed.own,
        near=handed.near,
        propose=handed.propose,
    )
    _refuse_endless(request)
    if prove is not None:
        refuse_unprovable(request, asked.name)
        _refuse_gap("prove", prove)
    if constraints:
        for n in asked.sizes:
            resolved, topology = asked.resolve(n), next(request.space(n).candidates()).topology
            nlp.refuse_unusable(constraints, resolved, topology)
            nlp.refuse_wrong_claims(constraints, resolved, topology, mirror=improper_isometry(resolved))
    path = RUNS / request.folder_name if out is None else Path(out)
    observer, until = observer or Silent(), time.monotonic() + time_limit
    if dask is None:  # else every worker compiles where it is
        nlp.prepare(asked, observer.note)
    with _engine(workers, dask, dask_tls, request.versions, observer) as engine:
        answer = run(
            request,
            path,
            _backends(constraints),
            engine=engine,
            observer=observer,
            workers=engine.count if isinstance(engine, Workers) else None,
            time_limit=time_limit,
            report=_write_page,
        )
        if prove is None or answer.best is None or not answer.complete:
            return answer
        return prove_run(
            path,
            nlp.prove_chunk,
            nlp.proof_root,
            gap=prove,
            key=None,
            engine=engine,
            observer=observer,
            time_limit=until - time.monotonic(),
            report=_write_page,
        )


def prove(
    folder: str | Path,
    *,
    gap: float = DEFAULT_GAP,
    problem: Problem = "task",
    topology: str | None = None,
    workers: int | None = None,
    dask: str | None = None,
    dask_tls: Certificates | None = None,
    time_limit: float = math.inf,
    observer: Observer | None = None,
) -> Answer:
    """Prove by branch and bound that no tree of a run beats its best design, or bound by how much one could.

    Proofs are written to `proof/KEY` and `candidates.csv` in the run folder, chunk by chunk; calling it again
    resumes a stopped proof.

    Args:
        folder: the run folder.
        gap: relative gap at which a tree counts as settled: how far its bound may stay below its own best effort,
            if that cannot be proven above the effort of the best.
        problem: designs that the proof is about: `task`, all that the audit may call clear; `solver`, those
            that also keep the solver's margin and its distance of centres.
        topology: key of a single tree to prove; default: all.
        workers: worker processes; default: the cores available. Results do not depend on it.
        dask: as for `search`.
        dask_tls: as for `search`.
        time_limit: stop after this time [s].
        observer: receives progress.

    Raises:
        BadInput: not a run folder, no audited design, no such tree, or another process is using the folder.
        ValueError: a gap beyond `limits`.
        WorkersLost: as for `search`.
    """
    _refuse_gap("gap", gap)
    observer = observer or Silent()
    with _engine(workers, dask, dask_tls, _versions(folder), observer) as engine:
        return prove_run(
            Path(folder),
            nlp.prove_chunk,
            nlp.proof_root,
            gap=gap,
            key=topology,
            engine=engine,
            observer=observer,
            problem=problem,
            time_limit=time_limit,
            report=_write_page,
        )


def _refuse_gap(name: str, gap: float) -> None:
    """Refuse a gap that no proof can be asked for."""
    least, most = GAPS
    if not least <= gap <= most:
        raise ValueError(f"`{least} <= {name} <= {most}` must hold, but got {gap}")


def check_proofs(
    folder: str | Path,
    *,
    topology: str | None = None,
    workers: int | None = None,
    dask: str | None = None,
    dask_tls: Certificates | None = None,
    observer: Observer | None = None,
) -> Checked:
    """Check what `prove` has proven of a run, by code that shares nothing with it; nothing is written.

    Args:
        folder: of the run.
        topology: key of the one tree to look at; default: all.
        workers: as of `search`.
        dask: as of `search`.
        dask_tls: as of `search`.
        observer: is told of the progress.

    Raises:
        BadInput: it is not a run folder, or has no audited design or no such tree.
        WorkersLost: as of `search`.
    """
    observer = observer or Silent()
    with _engine(workers, dask, dask_tls, _versions(folder), observer) as engine:
        return check_run(
            Path(folder), verify.check_chunk, verify.audit, key=topology, engine=engine, observer=observer
        )


def _versions(folder: str | Path) -> Mapping[str, str]:
    """Return the versions of the libraries that a run was computed with."""
    if not Path(folder).is_dir():
        raise BadInput(str(folder), [Fault("", "is not a run folder: it does not exist")])
    with RunFolder.load(Path(folder)) as found:
        return found.request.versions


def _refuse_endless(request: Request) -> None:
    """Refuse to solve all candidates where there are more than anybody can, before a folder is made for them."""
    if request.trials is not None:
        return
    for n in request.task.sizes:
        if (count := request.space(n).count()) > CANDIDATES:
            rule = (
                f"an exhaustive search takes at most {CANDIDATES:,} candidates, but {n} modules have "
                f"{Decimal(count):.1e}; choose the strategy `optuna`"
            )
            raise BadInput(request.task.name, [Fault("modules", rule)])


def _engine(
    workers: int | None,
    dask: str | None,
    certificates: Certificates | None,
    versions: Mapping[str, str],
    observer: Observer,
) -> Workers | DaskWorkers:
    """Return where jobs run: in processes of this machine, or in the workers of a Dask scheduler."""
    if dask is None:
        if certificates is not None:
            raise BadInput("dask_tls", [Fault("", "certificates need the address of a Dask scheduler, in dask")])
        return Workers(workers or available_cores())
    if workers is not None:
        raise BadInput("workers", [Fault("", "cannot be chosen with dask: all workers of the scheduler are used")])
    same = {**computing_versions(), **versions}
    return DaskWorkers(dask, same, note=observer.note, certificates=certificates)


def write_report(source: str | Path, *, out: str | Path | None = None, flight: str | Path | None = None) -> Path:
    """Write the report of a run, or of a single design after auditing it, and return its path.

    Args:
        source: a run's folder or a design's file.
        out: the page; default: `report.html` in the folder, or the design's name with `.html`.
        flight: a folder that `fly --out` wrote for the design, whose flights are shown too.

    Raises:
        BadInput: the source is neither, or the flights are not of it; or the page would go into a folder that a
            run is using, or replace a file that the run did not write.
        RuntimeError: the audit failed; the message gives the reason.
    """
    from topo_search.report.design_page import design_page
    from topo_search.report.page import render
    from topo_search.report.run_page import run_page, write_run_page
    from topo_search.report.simulated_part import read_simulated

    source = Path(source)
    if source.is_dir() and flight is not None:
        rule = f"must come with the file of the design that was flown, but got the folder {source}"
        raise BadInput("--flight", [Fault("", rule)])
    if source.is_dir() and out is None:
        with RunFolder.load(source, writes=True) as folder:
            write_run_page(folder)
        return source / REPORT
    if source.is_dir():
        with RunFolder.load(source) as folder:
            page = run_page(folder)
    else:
        design = read_json(Design, source)
        simulated = None if flight is None else read_simulated(Path(flight), design)
        page = design_page(design, audit(design), source.name, simulated)
    path = Path(out or source.with_suffix(".html"))
    write_atomically(path, render(page))
    return path


def figure(design: Design, audited: Audit | None = None) -> Any:
    """Return an interactive 3-D Plotly figure of a design; given its audit, also the closest pair and the rod."""
    from topo_search.export.viewpoint import poses_to_draw
    from topo_search.report.scene import scene

    at = poses_to_draw(design)
    if audited is None:
        return scene(design, at)
    closest = min(audited.pairs, key=lambda pair: pair.analytic_m, default=None)
    return scene(design, at, closest, audited.assembly)


def solve(
    task: Task | str | Path,
    topology: Topology,
    *,
    starts: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    near: Iterable[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
    progress: Callable[[Outcome], None] = lambda _: None,
    note: Callable[[str], None] = lambda _: None,
) -> Solved:
    """Find the best design of one topology and audit it, both in a child process.

    Without `starts` and `time_limit` it ends after three rounds of starts in a row without improvement.

    Args:
        task: a task, its file, or the name of a shipped example, of any number of modules.
        topology: the tree.
        starts: number of starts.
        seed: random seed of the starts.
        time_limit: stop solving after this time [s].
        near: designs of any trees to start from as well, beside the first round's starts.
        constraints: your own constraints on the design; they are evaluated, not certified.
        progress: receives the best outcome after each round.
        note: receives messages about slow preparations.

    Raises:
        BadInput: the task, or what is your own, is invalid, or its connectors do not allow the topology.
        ValueError: the number of starts is out of range (`limits`).
    """
    if starts is not None and not 1 <= starts <= STARTS:
        raise ValueError(f"`1 <= starts <= {STARTS:,}` must hold, but got {starts:,}")
    if topology.n > MODULES:
        raise BadInput("topology", [Fault("", f"must have at most {MODULES} modules, but got {topology.n:,}")])
    asked = _task(task)
    resolved = asked.resolve(topology.n)
    if resolved.search.connectors == "aligned" and not topology.aligned:
        rule = f'{topology.key} needs search.connectors = "any", but the task has "aligned"'
        raise BadInput(resolved.name, [Fault("topology", rule)])
    designs = starting_points(near)
    if constraints:
        stated(constraints)
        nlp.refuse_unusable(constraints, resolved, topology)
    nlp.prepare(resolved, note)
    return solve_single(
        resolved,
        topology,
        _backends(constraints),
        starts=starts,
        round_size=nlp.default_starts(resolved),
        seed=seed,
        time_limit=time_limit,
        progress=progress,
        near=designs,
    )


@dataclass(frozen=True)
class Rounded:
    """A design with rounded hinge angles, and the audits before and after."""

    design: Design
    audit: Audit
    before: Audit
    step_deg: float
    """[deg]"""
    effort: float
    """Its control effort over that before."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What rounding changed, one sentence each."""
        least = (min((pair.analytic_m for pair in each.pairs), default=None) for each in (self.before, self.audit))
        was, now = ("none" if one is None else f"{1000 * one:.3g} mm" for one in least)
        return (
            f"Hinge angles are rounded to {self.step_deg:g} deg and the inputs recomputed: "
            f"control effort {100 * (self.effort - 1):+.3g} %.",
            f"Audit: {self.audit.verdict} (before: {self.before.verdict}); least clearance {now} (before: {was}).",
        )


def rounded(design: Design, step_deg: float) -> Rounded:
    """Round the hinge angles of a design, recompute its inputs and audit it again.

    The root orientation is kept: the autopilot holds it, no bracket does.

    Args:
        design: the design.
        step_deg: step to round hinge angles to [deg].

    Raises:
        BadInput: with these angles the rotors can no longer produce a load case.
        RuntimeError: an audit failed; the message gives the reason.
    """
    from nlp.numbers.refit import NotPossible, refit

    angles = [math.radians(step_deg * round(math.degrees(alpha) / step_deg)) for alpha in design.hinge_angles_rad]
    try:
        found = refit(design, angles)
    except NotPossible as error:
        raise BadInput(
            "--angle-step", [Fault("", f"{error} with angles rounded to {step_deg:g} deg; choose a smaller step")]
        ) from None
    before, after = (audit(each) for each in (design, found))
    effort = found.objective / design.objective if design.objective else 1.0
    return Rounded(found, after, before, step_deg, effort)


def brackets_note(design: Design) -> str:
    """Return what the audit proves of the brackets of a kit, stated or not, beside airflow and rotors.

    Raises:
        RuntimeError: the audit failed, with the reason.
    """
    module = design.task.module
    stated = module.model_copy(update={"bracket": module.bracket_sizes})
    task = design.task.model_copy(update={"module": stated})
    kinds = ("bracket-airflow", "bracket-rotor")
    rows = [one for one in audit(design.model_copy(update={"task": task})).pairs if one.kind in kinds]
    if not rows:
        return "Brackets: there are no joints, or numbers are too large to audit them."
    least = min(rows, key=lambda row: (row.status is Status.CLEAR, row.analytic_m))
    if least.status is Status.CLEAR:
        return (
            "Brackets are audited clear of all airflow and rotors; the least clearance is "
            f"{1000 * least.analytic_m:.3g} mm, {least.name}."
        )
    return f"Brackets are not clear: {least.name}, {1000 * least.analytic_m:.3g} mm ({least.status})."


def audit(design: Design, *, constraints: Sequence[OwnConstraint] = ()) -> Audit:
    """Return the exact audit of a design, made in a child process.

    Args:
        design: the design.
        constraints: of your own, evaluated on it; those that it names but that are not given are `not checked`.

    Raises:
        BadInput: a constraint cannot be used.
        RuntimeError: says why there is no audit.
    """
    if constraints:
        stated(constraints)
        nlp.refuse_unusable(constraints, design.task, design.topology)
    (result,) = audits([design], constraints=constraints)
    if isinstance(result, Failed):
        raise RuntimeError(f"the audit failed: {result.reason}")
    return result


def audits(
    designs: Iterable[Design], *, workers: int = 1, constraints: Sequence[OwnConstraint] = ()
) -> Iterator[Audit | Failed]:
    """Yield the audit of each design in order, made in child processes.

    Args:
        designs: drawn lazily, a few ahead of the audits.
        workers: number of processes.
        constraints: as of `audit`.
    """
    ended: dict[int, Audit | Failed] = {}
    due = 0
    with Workers(workers) as pool:
        results = pool.run(
            partial(_audit_numbered, _backends(constraints).audit),
            enumerate(designs),
            deadline=lambda job: audit_deadline(job[1].topology.n),
        )
        for (number, _), result in results:
            ended[number] = result
            while due in ended:
                yield ended.pop(due)
                due += 1


def _audit_numbered(audit: AuditDesign, numbered: tuple[int, Design]) -> Audit:
    """Audit a design that comes with its number (in a worker)."""
    return audit(numbered[1])


def available_cores() -> int:
    """Return the number of cores that this process may use, at most the largest number of workers."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, WORKERS)


def _write_page(folder: RunFolder) -> None:
    """Write a run's page: only the coordinator loads what it takes, not the workers."""
    from topo_search.report.run_page import write_run_page

    write_run_page(folder)


def _task(task: Task | str | Path) -> Task:
    return task if isinstance(task, Task) else read_task(task)
