"""Searches of all trees of a task, proofs that none is better, and checks of those proofs."""

import math
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import nlp
import verify
from topo_search.compose import binding
from topo_search.compose.designs import write_page
from topo_search.engine import DaskWorkers, Workers
from topo_search.limits import LIMITS
from topo_search.model import BadInput, Design, Fault, Task, as_bad_input
from topo_search.model.proof import Problem
from topo_search.model.search import Maximized
from topo_search.model.task_file import read_task
from topo_search.own_constraint import OwnConstraint
from topo_search.report.shown import visible_progress
from topo_search.report.task_warnings import warn
from topo_search.study import Answer, Checked, Observer, run
from topo_search.study import check as check_run
from topo_search.study import prove as prove_run
from topo_search.study.optima import keep_optima
from topo_search.study.progress import solving_seconds
from topo_search.study.proving import refuse_unprovable
from topo_search.study.request import DEFAULT_ROUND, Request, StrategyName, UserInputs, digest
from topo_search.topologies import Symmetry, improper_isometry
from topo_search.topologies.own_topologies import OwnTopology, own_candidates


def search(
    task: Task | str | Path,
    *,
    out: str | Path | None = None,
    symmetry: Symmetry = "task",
    strategy: StrategyName | None = None,
    sampler: binding.AnySampler = "moves",
    trials: int | None = 512,
    round_size: int = DEFAULT_ROUND,
    prune: bool = False,
    starts: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    dask: str | None = None,
    time_limit: float = math.inf,
    near: Iterable[Design] = (),
    constraints: Iterable[OwnConstraint] = (),
    topologies: Iterable[OwnTopology] | None = None,
    prove: float | None = None,
    keep_within: float | None = None,
    maximize: Maximized | None = None,
    observer: Observer | None = None,
    live: bool = False,
) -> Answer:
    """Search the topologies for the best design of a task, audit the best ones and write a run folder.

    Python warns about suspicious values of the task (`SuspiciousTask`).

    Args:
        task: a task, its file, or the name of a shipped example.
        out: the run's folder; default: `runs/NAME-HASH`.
        symmetry: symmetries under which trees count as one candidate.
        strategy: `exhaustive` solves every candidate; `optuna` those that a sampler proposes; `randomized` asks
            each for a larger value than the best so far. Default: `randomized` if a quantity is maximised, else
            `exhaustive`, but a new search of over a day is refused unless there is a time limit or Dask.
        sampler: sampling algorithm: `moves` on the best trees, `tpe`, `nsga2` or `random`; or your own: an
            `OwnSampler`, a function that makes any Optuna sampler or a `TopologySampler` for a seed, or a
            `TopologySampler` without state.
        trials: with `optuna`, number of candidates to propose; None: all.
        round_size: with `optuna`, number of proposals that may be pending at a time. More keep more workers busy,
            but the sampler learns later from them.
        prune: skip candidates that the lower bound proves no better than the best design so far.
        starts: starts per candidate, or per finalist if not all candidates are proposed; default: by the number of
            modules.
        seed: random seed of starts and proposals.
        workers: worker processes; default: the cores available. Results do not depend on it.
        dask: address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT, whose workers replace local
            processes. Plain tcp is not authenticated, although results are unpickled; tls needs certificates in
            Dask's configuration.
        time_limit: stop solving, or proving, after this time [s].
        near: designs of any trees; each adds one start to every candidate.
        constraints: your own constraints on designs. They are evaluated, not certified; unless they are declared
            `invariant`, every rooted tree is a candidate.
        topologies: the only candidates: trees, keys, or graphs (see `Topology.graph`). Each is solved as given.
        prove: relative gap within which branch and bound then proves that no tree is better; see `prove`.
        keep_within: keep every local optimum with a clear audit and at most this much more effort than the
            best [%].
        maximize: quantity of which the best platform has the largest value, as `search.maximize` of the task.
        observer: receives progress; default: a bar in a terminal, a line in a notebook, else `SilentObserver()`.
        live: serve the page to this machine while the search runs; the observer receives its address as a note.

    Raises:
        BadInput: the task, the folder, the address, a certificate or your own code is invalid, or there are too
            many candidates to solve all of them.
        ValueError: starts, trials, round_size or workers are out of range (`limits`), or strategy or sampler is
            unknown.
        WorkersLost: workers do not start or return, or the Dask scheduler does not answer; results so far are kept.

    Example:
        >>> from topo_search import read_task, search
        >>> hover = "load_cases=[{com={force=[0.0,0.0,1.0]}}]"
        >>> task = read_task("push", ("modules=2", hover))
        >>> answer = search(task, out="hover-2", starts=1)
        >>> answer.best.key, answer.best.modules, answer.audit.verdict.value
        ('a10', 2, 'clear')
    """
    base_task = binding.enclose_speed(task if isinstance(task, Task) else read_task(task))
    if maximize is not None:
        with as_bad_input(base_task.name):
            base_task = base_task.replace(search=base_task.search.replace(maximize=maximize))
    warn(base_task)
    by_default: StrategyName = "exhaustive" if base_task.search.maximize is None else "randomized"
    designs, checked, own_sampler = (
        binding.starting_points(near),
        binding.own_constraints(constraints),
        binding.named_sampler(sampler),
    )
    request = Request(
        base_task,
        symmetry,
        nlp.default_starts(base_task) if starts is None else starts,
        int(seed),  # of NumPy, too
        strategy or by_default,
        sampler if isinstance(sampler, str) else "moves",
        trials if strategy == "optuna" else None,
        prune and strategy != "optuna",
        round_size,
        user_inputs=UserInputs(
            topologies=None if topologies is None else own_candidates(topologies, base_task),
            near=tuple(digest(design.model_dump(mode="json", exclude={"solver"})) for design in designs),
            constraints=tuple(constraint.stated for constraint in checked),
            sampler=None if own_sampler is None else own_sampler.stated,
        ),
        near=designs,
        sampler_factory=None if own_sampler is None else own_sampler.make,
    )
    path = Path("runs") / request.folder_name if out is None else Path(out)
    may_take_long = strategy is not None or dask is not None or math.isfinite(time_limit) or path.exists()
    # an exhaustive search of more than a day on all cores has to be requested
    _refuse_too_long(request, math.inf if may_take_long else 24 * 3600.0 * (workers or binding.available_cores()))
    if keep_within is not None and (prune or not 0 <= keep_within <= LIMITS.percent):
        raise ValueError(f"`0 <= keep_within <= {LIMITS.percent}` must hold without `prune`, but got {keep_within}")
    if keep_within is not None and base_task.search.maximize is not None:
        raise ValueError("`keep_within` cannot be combined with `search.maximize`: it compares efforts")
    if prove is not None:
        refuse_unprovable(request, base_task.name)
        _refuse_gap("prove", prove)
    if own_sampler is not None:
        from topo_search.engine.proposals import make_user_sampler

        make_user_sampler(own_sampler.make, seed)
    for n in base_task.sizes if checked else ():
        topology = next(request.space(n).candidates()).topology
        resolved = base_task.resolve(n).on(topology)
        nlp.refuse_unusable(checked, resolved, topology)
        nlp.refuse_wrong_claims(checked, resolved, topology, mirror=improper_isometry(resolved))
    deadline = time.monotonic() + time_limit

    def prepare() -> None:
        nonlocal deadline
        engine.prepare(nlp.prepare, base_task, shown.note)
        deadline = time.monotonic() + time_limit

    def prove_best() -> Answer:
        return _prove(path, engine, listener, gap=prove, time_limit=deadline - time.monotonic())

    served: Callable[[Observer], AbstractContextManager[Observer]] = nullcontext
    if live:
        from topo_search.report.live import serve_live  # slow to import

        served = partial(serve_live, path)
    with (
        visible_progress(observer) as shown,
        binding.open_engine(workers, dask, shown) as engine,
        served(shown) as listener,
    ):
        return run(
            request,
            path,
            binding.backends(checked),
            engine=engine,
            observer=listener,
            workers=engine.count if isinstance(engine, Workers) else None,
            time_limit=time_limit,
            prepare=prepare,
            report=write_page,
            prove=None if prove is None else prove_best,
            after_size=[] if keep_within is None else [partial(keep_optima, percent=keep_within)],
        )


def prove(
    folder: str | Path,
    *,
    gap: float = 0.003,
    problem: Problem = "task",
    topology: str | None = None,
    lender: str | Path | None = None,
    workers: int | None = None,
    dask: str | None = None,
    time_limit: float = math.inf,
    observer: Observer | None = None,
) -> Answer:
    """Prove by branch and bound that no tree of a run beats its best design, or bound by how much one could.

    Proofs are written to `proof/KEY` and `candidates.csv` in the run folder, chunk by chunk. The same call resumes
    a stopped proof.

    Args:
        folder: the run folder.
        gap: relative gap at which a tree counts as settled: how far its bound may lie below its own best effort, if
            the tree cannot be excluded.
        problem: designs that the proof covers: `task`, all that the audit may call clear; `solver`, those that also
            keep the solver's margin and its distance between centres.
        topology: key of a single tree to prove; default: all trees.
        lender: folder of another run, whose task differs only in name and exposure. Its complete proofs are reused
            where they suffice for `gap`.
        workers: worker processes; default: the cores available. Results do not depend on it.
        dask: as for `search`.
        time_limit: stop after this time and keep the proofs so far [s].
        observer: as for `search`.

    Raises:
        BadInput: the folder is not a run, has no audited design or no such tree, or is in use by another process;
            or no proof of `lender` applies to it.
        ValueError: the gap is out of range (`limits`).
        WorkersLost: as for `search`.

    Example:
        >>> from topo_search import prove
        >>> prove("hover-2", gap=0.01).proven  # doctest: +SKIP
        True
    """
    _refuse_gap("gap", gap)
    with visible_progress(observer) as shown, binding.open_engine(workers, dask, shown) as engine:
        options = {"gap": gap, "key": topology, "problem": problem, "time_limit": time_limit}
        return _prove(Path(folder), engine, shown, source_run=lender and Path(lender), **options)


def _prove(path: Path, engine: Workers | DaskWorkers, observer: Observer, **options: Any) -> Answer:
    """Prove with the solver's bounds; options as for `topo_search.study.prove`."""
    prepare = partial(engine.prepare, nlp.prepare_proof, note=observer.note)
    options |= {"engine": engine, "observer": observer, "prepare": prepare, "report": write_page}
    return prove_run(path, nlp.prove_chunk, nlp.proof_root, binding.backends(()).solve, **options)


def _refuse_gap(name: str, gap: float) -> None:
    """Raise ValueError if a gap is out of range; `name` is the parameter's."""
    smallest, largest = LIMITS.gaps
    if not smallest <= gap <= largest:
        raise ValueError(f"`{smallest} <= {name} <= {largest}` must hold, but got {gap}")


def check_proofs(
    folder: str | Path,
    *,
    topology: str | None = None,
    workers: int | None = None,
    dask: str | None = None,
    observer: Observer | None = None,
) -> Checked:
    """Check the proofs of a run with code that shares nothing with the prover, and write nothing.

    Args:
        folder: the run folder.
        topology: key of a single tree to check; default: all trees.
        workers: as for `search`.
        dask: as for `search`.
        observer: as for `search`.

    Raises:
        BadInput: the folder is not a run, or has no audited design or no such tree.
        WorkersLost: as for `search`.
    """
    with visible_progress(observer) as shown, binding.open_engine(workers, dask, shown) as engine:
        return check_run(
            Path(folder),
            verify.check_chunk,
            verify.audit,
            key=topology,
            engine=engine,
            observer=shown,
            prepare=partial(engine.prepare, verify.prepare_check, note=shown.note),
        )


def _refuse_too_long(request: Request, longest: float) -> None:
    """Raise BadInput if solving all candidates would take too long, before a folder is made.

    Args:
        request: the request of the run.
        longest: largest processor time that is acceptable [s].
    """
    if request.trials is not None:
        return
    seconds = 0.0
    for n in request.task.sizes:
        if (count := request.space(n).count()) > LIMITS.candidates:
            rule = (
                f"an exhaustive search takes at most {LIMITS.candidates:,} candidates, but {n} modules have "
                f"{Decimal(count):.1e}; choose the strategy `optuna`"
            )
            raise BadInput(request.task.name, [Fault("modules", rule)])
        seconds += count * solving_seconds(request.task.resolve(n), request.starts)
    if seconds > longest:
        rule = (
            f"all candidates take about {seconds / 3600:,.0f} hours of processor time; choose the strategy: "
            "`optuna` solves the most promising, `exhaustive` all of them"
        )
        raise BadInput(request.task.name, [Fault("modules", rule)])
