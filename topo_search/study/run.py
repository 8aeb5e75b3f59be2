"""A run: the loop that searches, audits and reports; this page is the algorithm.

For every size, smallest first: every candidate that the strategy proposes is solved and recorded in the ledger,
then the best designs are audited. Where no size has a design, the limits that prevent one are sought. All files of
the run's folder are written, the report last; if asked, branch and bound then proves that no tree is better.
Everything is derived from the ledger: a run that was stopped continues where it was, and computes nothing twice.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from topo_search.engine import Backends, Engine, Strategy, WorkersLost
from topo_search.study.answer import Answer, quotient_remark
from topo_search.study.directory import ReadOnlyFolder
from topo_search.study.folder import RunFolder
from topo_search.study.ledger_file import KEPT
from topo_search.study.optima import keep_optima, write_front
from topo_search.study.progress import WRITING, Observer, proof_phase, remaining_plan
from topo_search.study.relaxing import find_causes
from topo_search.study.request import Request
from topo_search.study.solving import Proposals, Tools, audit_best, record_proof, record_pruned, strategy_of
from topo_search.study.summary import answer_of, finished_answer, refuse_lost


def run(
    request: Request,
    path: Path,
    backends: Backends,
    *,
    engine: Engine,
    observer: Observer,
    workers: int | None = None,
    time_limit: float = math.inf,
    prepare: Callable[[], None] = lambda: None,
    report: Callable[[RunFolder], None] = lambda _: None,
    prove: Callable[[], Answer] | None = None,
    keep_within: float | None = None,
) -> Answer:
    """Do what is still to be done of a run, and return its answer.

    Args:
        request: the task and how it is searched.
        path: the run's folder; made if there is none, taken up again if there is.
        backends: solver, audit and bounds.
        engine: where jobs run; it changes nothing but the time it takes.
        observer: receives the progress.
        workers: how many jobs the engine runs at a time; None where that is not known.
        time_limit: seconds after which no more is solved, from the end of `prepare`; the best designs are audited
            all the same.
        prepare: is called before the first candidate is solved, if any is.
        report: writes the page of the folder once all its files are written.
        prove: then proves what can be proven of a complete answer.
        keep_within: keeps every local optimum whose effort is at most so much over the best [%].

    Raises:
        BadInput: the folder cannot be used: it may be read-only if the run in it has ended.
        KeyboardInterrupt: after Ctrl-C, with all results kept and all files written; a note (PEP 678) says so.
        WorkersLost: the engine has no workers any more; likewise.
        LedgerLost: the folder or its ledger vanished; it has what can still be read of the answer.
    """
    try:
        with RunFolder.open(path, request) as folder, refuse_lost(folder):
            try:
                plan = remaining_plan(folder, workers, time_limit)
                if plan.solves or keep_within is not None:
                    prepare()
                tools = Tools(backends, engine, observer, time.monotonic() + time_limit)
                observer.plan(plan)
                for number, level in enumerate(folder.levels):  # one, unless the task has goals
                    if level.request.level is not None:
                        observer.note(f"level {number} of {len(folder.levels)}: {level.request.level.words}")
                    sizes, of_level = level.request.task.sizes, share_time(tools, len(folder.levels) - number)
                    for index, n in enumerate(sizes):
                        of_size = share_time(of_level, len(sizes) - index)
                        search_size(level, n, of_size)
                        if keep_within is not None:
                            keep_optima(level, n, keep_within, of_size)
                find_causes(folder.levels[0], tools)
            except (KeyboardInterrupt, WorkersLost) as stop:
                write_files(folder)
                folder.ledger.require()
                stop.add_note(KEPT)
                raise
            observer.phase(WRITING)
            write_files(folder)
            report(folder)
            folder.ledger.require()
            answer = answer_of(folder)
    except ReadOnlyFolder:
        if (finished := finished_answer(path, request)) is None:
            raise
        answer = finished
    return prove() if prove is not None and answer.best is not None and answer.complete else answer


def search_size(folder: RunFolder, n: int, tools: Tools) -> None:
    """Solve the candidates of n modules that are not in the ledger yet, and audit the best."""
    ledger, request = folder.ledger, folder.request
    contexts, quotient = request.contexts(n), request.quotient(n)
    context, bound = contexts[0], ledger.bound(contexts[0])
    if bound is None:
        tools.observer.phase(proof_phase(n))
        bound = tools.backends.lower_bound(context.task), tools.backends.prove_impossible(context.task)
        ledger.begin(context, *bound)
    lower_bound, impossible = bound
    if not quotient.exact:
        tools.observer.note(quotient_remark(quotient))
    if impossible is not None:
        record_proof(folder, n, impossible, lower_bound)
        return
    for each in contexts:
        ledger.forget_audit_failures(each)
    if ledger.has_ended(context, request.starts, request.trials) and not ledger.has_failures(context):
        audit_best(folder, n, lower_bound, tools)
        return
    timed = math.isfinite(tools.until)
    strategy = strategy_of(folder, n, bound=lower_bound if request.prune else -math.inf, timed=timed)
    ended = solve_proposals(strategy, folder, n, lower_bound, tools)
    audit_best(folder, n, lower_bound, tools)
    if ended and request.prune and not record_pruned(folder, n, lower_bound):
        strategy = strategy_of(folder, n, timed=timed)  # the design that ruled others out is not clear
        ended = solve_proposals(strategy, folder, n, lower_bound, tools)
        audit_best(folder, n, lower_bound, tools)
    if ended:
        ledger.end(context, request.starts, request.trials)


def solve_proposals(strategy: Strategy, folder: RunFolder, n: int, lower_bound: float, tools: Tools) -> bool:
    """Solve and record what a strategy proposes; return whether it came to its end in time."""
    candidates = Proposals(strategy, folder, n, lower_bound, tools.observer)
    jobs = candidates.jobs()
    with closing(tools.solve(jobs)) as outcomes:
        for job, outcome in outcomes:
            candidates.record(job, outcome)
    next(jobs, None)  # what is known may be all, also where no time was left to look
    return strategy.over


def share_time(tools: Tools, parts: int) -> Tools:
    """Return the same tools with an equal share of the time that is left."""
    now = time.monotonic()
    return tools if parts == 1 else replace(tools, until=now + (tools.until - now) / parts)


def write_files(folder: RunFolder) -> None:
    """Write all files but the ledger and the page."""
    for level in folder.levels:
        level.write()
    if folder.request.task.goals.names:
        write_front(folder)
