"""Where solver, audit and search meet: the Python interface, and what the command line calls.

Call these from under `if __name__ == "__main__":` in a script, for they start worker processes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import nlp
import verify
from topo_search.engine import (
    AuditDesign,
    Certificates,
    DaskWorkers,
    Failed,
    Outcome,
    Verbs,
    Workers,
    audit_deadline,
    computing_versions,
)
from topo_search.limits import CANDIDATES, MODULES, STARTS, WORKERS
from topo_search.model import Audit, BadInput, Design, Fault, Infeasible, ResolvedTask, Task, Topology
from topo_search.model.files import read_json, read_task, write_atomically
from topo_search.study import (
    REPORT,
    Answer,
    Observer,
    Request,
    RunFolder,
    Sampler,
    Silent,
    Solved,
    StrategyName,
    run,
    solve_single,
)
from topo_search.study import prove as prove_run
from topo_search.topologies import Symmetry


def _solve(
    task: ResolvedTask, topology: Topology, *, starts: range, seed: int, near: Sequence[Design] = ()
) -> Design | Infeasible:
    """Solve one topology, and choose where the rod of a design's end-effector is bolted."""
    outcome = nlp.solve(task, topology, starts=starts, seed=seed, near=near)
    if isinstance(outcome, Design):
        return outcome.model_copy(update={"mount": verify.choose_mount(outcome)})
    return outcome


VERBS = Verbs(solve=_solve, audit=verify.audit, lower_bound=nlp.lower_bound, prove_impossible=nlp.prove_impossible)

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
    sampler: Sampler = "moves",
    trials: int | None = DEFAULT_TRIALS,
    prune: bool = False,
    starts: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    dask: str | None = None,
    dask_tls: Certificates | None = None,
    time_limit: float = math.inf,
    observer: Observer | None = None,
) -> Answer:
    """Search the topologies for the best design of a task, audit the best, and keep all of it in a folder.

    Args:
        task: a task, its file, or the name of a shipped example.
        out: the run's folder; default: `runs/NAME-HASH`.
        symmetry: which trees count as one candidate.
        strategy: `exhaustive` solves every candidate; `optuna` those that a sampler proposes, one after the other.
        sampler: what proposes them: `moves` on the best trees, `tpe`, `nsga2` or `random`.
        trials: how many are proposed; None: all.
        prune: whether an exhaustive search skips candidates that are proven to be no better than the best so far.
        starts: starts of each candidate, or of the best if not all are proposed; default: the solver's.
        seed: draws the starts and the proposals.
        workers: worker processes; default: the cores available. They change nothing but the time it takes.
        dask: the address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT, whose workers take the place of
            processes here; tcp trusts whoever answers there, for what comes back is unpickled.
        dask_tls: certificates for tls; default: those of Dask's own configuration.
        time_limit: seconds after which no more is solved.
        observer: is told of the progress.

    Raises:
        BadInput: the task, the folder, the address or a certificate cannot be used, or there are too many
            candidates to solve all.
        ValueError: no starts, trials or workers, or more than `limits` allows; or a strategy or sampler that there
            is not.
        WorkersLost: workers do not start or do not come back, or the Dask scheduler does not answer, or is gone;
            results are kept.
    """
    asked = _task(task)
    request = Request(
        asked,
        symmetry,
        nlp.default_starts(asked) if starts is None else starts,
        seed,
        strategy,
        sampler,
        trials if strategy == "optuna" else None,
        prune and strategy == "exhaustive",
    )
    _refuse_endless(request)
    path = RUNS / request.folder_name if out is None else Path(out)
    observer = observer or Silent()
    if dask is None:  # else every worker compiles where it is
        nlp.prepare(asked, observer.note)
    with _engine(workers, dask, dask_tls, request.versions, observer) as engine:
        return run(
            request, path, VERBS, engine=engine, time_limit=time_limit, observer=observer, report=_write_page
        )


def prove(
    folder: str | Path,
    *,
    gap: float = DEFAULT_GAP,
    topology: str | None = None,
    workers: int | None = None,
    dask: str | None = None,
    dask_tls: Certificates | None = None,
    time_limit: float = math.inf,
    observer: Observer | None = None,
) -> Answer:
    """Prove by branch and bound that no tree of a run can beat its best design, or by how little one can.

    What is proven of every tree goes to `proof/KEY` and `candidates.csv` in the run's folder, chunk by chunk; the
    same call resumes a stopped one.

    Args:
        folder: of the run.
        gap: how far, as a share, the bound of a tree may stay under its own best effort, where that cannot be above
            the effort of the best.
        topology: key of the one tree to look at; default: all.
        workers: worker processes; default: the cores available. They change nothing but the time it takes.
        dask: as of `search`.
        dask_tls: as of `search`.
        time_limit: seconds after which no more is searched.
        observer: is told of the progress.

    Raises:
        BadInput: it is no run's folder, has no audited design or no such tree, or another process works in it.
        WorkersLost: as of `search`.
    """
    observer = observer or Silent()
    if not Path(folder).is_dir():
        raise BadInput(str(folder), [Fault("", "is no run's folder: there is no such folder")])
    with RunFolder.found(Path(folder)) as found:
        versions = found.request.versions
    with _engine(workers, dask, dask_tls, versions, observer) as engine:
        return prove_run(
            Path(folder),
            nlp.prove_chunk,
            nlp.proof_root,
            gap=gap,
            key=topology,
            engine=engine,
            observer=observer,
            time_limit=time_limit,
            report=_write_page,
        )


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


def write_report(source: str | Path, *, out: str | Path | None = None) -> Path:
    """Write the page of a run, or of a single design after auditing it, and return where it is.

    Args:
        source: a run's folder or a design's file.
        out: the page; default: `report.html` in the folder, or the design's name with `.html`.

    Raises:
        BadInput: it is neither; or the page is to go into a folder in which a run works, or in the place of a file
            that the run did not write.
        RuntimeError: the audit failed, with the reason.
    """
    from topo_search.report.design_page import design_page
    from topo_search.report.page import render
    from topo_search.report.run_page import run_page, write_run_page

    source = Path(source)
    if source.is_dir() and out is None:
        with RunFolder.found(source, writes=True) as folder:
            write_run_page(folder)
        return source / REPORT
    if source.is_dir():
        with RunFolder.found(source) as folder:
            page = run_page(folder)
    else:
        design = read_json(Design, source)
        page = design_page(design, audit(design), source.name)
    path = Path(out or source.with_suffix(".html"))
    write_atomically(path, render(page))
    return path


def figure(design: Design, audited: Audit | None = None) -> Any:
    """Return a design in interactive 3-D, a Plotly figure; with its audit, the closest pair and the rod too."""
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
    progress: Callable[[Outcome], None] = lambda _: None,
    note: Callable[[str], None] = lambda _: None,
) -> Solved:
    """Find the best design of one topology and audit it, both in a child process.

    Without `starts` and `time_limit` it ends when three rounds of starts in a row did not pay.

    Args:
        task: a task, its file, or the name of a shipped example, of any number of modules.
        topology: the tree.
        starts: number of starts.
        seed: draws them.
        time_limit: seconds after which no more is solved.
        progress: is told the best outcome after each round.
        note: is told what takes a while before.

    Raises:
        BadInput: the task cannot be used, or its connectors do not allow the topology.
        ValueError: no starts, or more than `limits` allows.
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
    nlp.prepare(resolved, note)
    return solve_single(
        resolved,
        topology,
        VERBS,
        starts=starts,
        round_size=nlp.default_starts(resolved),
        seed=seed,
        time_limit=time_limit,
        progress=progress,
    )


@dataclass(frozen=True)
class Rounded:
    """A design whose hinge angles are multiples of a step, beside the one that it was made of."""

    design: Design
    audit: Audit
    before: Audit
    step_deg: float
    """[deg]"""
    effort: float
    """Its control effort over that before."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What changed, a sentence each."""
        least = (min((pair.analytic_m for pair in each.pairs), default=None) for each in (self.before, self.audit))
        was, now = ("none" if one is None else f"{1000 * one:.3g} mm" for one in least)
        return (
            f"Hinge angles are rounded to {self.step_deg:g} deg, and the inputs found again for them: "
            f"control effort {100 * (self.effort - 1):+.3g} %.",
            f"Audit: {self.audit.verdict} (before: {self.before.verdict}); least clearance {now} (before: {was}).",
        )


def rounded(design: Design, step_deg: float) -> Rounded:
    """Round the hinge angles of a design, find the inputs for them and audit it again.

    The root's orientation stays: nothing is bolted at that angle, an autopilot holds it.

    Args:
        design: the design.
        step_deg: hinge angles become multiples of it [deg].

    Raises:
        BadInput: with these angles rotors can no longer produce a load case.
        RuntimeError: an audit failed, with the reason.
    """
    from nlp.refit import NotPossible, refit

    angles = [math.radians(step_deg * round(math.degrees(alpha) / step_deg)) for alpha in design.hinge_angles_rad]
    try:
        found = refit(design, angles)
    except NotPossible as error:
        raise BadInput(
            "--angle-step", [Fault("", f"{error} with angles to {step_deg:g} deg; choose less")]
        ) from None
    before, after = (audit(each) for each in (design, found))
    effort = found.objective / design.objective if design.objective else 1.0
    return Rounded(found, after, before, step_deg, effort)


def audit(design: Design) -> Audit:
    """Return the exact audit of a design, made in a child process; RuntimeError says why there is none."""
    (result,) = audits([design])
    if isinstance(result, Failed):
        raise RuntimeError(f"the audit failed: {result.reason}")
    return result


def audits(designs: Iterable[Design], *, workers: int = 1) -> Iterator[Audit | Failed]:
    """Yield the audit of each design in turn, made in child processes.

    Args:
        designs: drawn lazily, a few ahead of the audits.
        workers: number of processes.
    """
    ended: dict[int, Audit | Failed] = {}
    due = 0
    with Workers(workers) as pool:
        results = pool.run(
            partial(_audit_numbered, VERBS.audit),
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
    """Return the number of cores that this process may use, as far as there may be a worker on each."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, WORKERS)


def _write_page(folder: RunFolder) -> None:
    """Write a run's page: only the coordinator loads what it takes, not the workers."""
    from topo_search.report.run_page import write_run_page

    write_run_page(folder)


def _task(task: Task | str | Path) -> Task:
    return task if isinstance(task, Task) else read_task(task)
