"""A run: search, audit, report. This page is the algorithm.

For every size, smallest first: solve every candidate that the strategy proposes, record each in the ledger, then
audit the best designs. If no design holds the defaults of a flying task, do the same without them. If no size has a
design, find the limits that prevent one. Write all files of the run's
folder, the report last; if asked, prove by branch and bound that no tree is better.

Everything derives from the ledger: a stopped run resumes where it was and computes nothing twice.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from topo_search.engine import Backends, Engine, WorkersLost
from topo_search.limits import quantity
from topo_search.model import BadInput
from topo_search.study.answer import Answer, quotient_remark
from topo_search.study.answering import answer_of, complete_answer, detect_loss
from topo_search.study.directory import ReadOnlyFolder
from topo_search.study.features import AFTER_SEARCH, FILES, STRATEGIES, remaining_plan
from topo_search.study.folder import RunFolder
from topo_search.study.ledger_file import KEPT
from topo_search.study.progress import WRITING, Observer, proof_phase
from topo_search.study.request import Request
from topo_search.study.solving import ProposedJobs, Tools, audit_best, record_proof, record_pruned

AfterSize = Callable[[RunFolder, int, Tools], None]
"""Step after the search of a number of modules."""


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
    after_size: Sequence[AfterSize] = (),
) -> Answer:
    """Start or resume a run, and return its answer.

    Args:
        request: task and settings of the search.
        path: the run's folder; created if it does not exist, resumed if it does.
        backends: solver, audit and bounds.
        engine: runs the jobs; affects only the time.
        observer: receives the progress.
        workers: number of jobs that the engine runs at a time; None if unknown.
        time_limit: seconds of solving after `prepare`; the best designs are audited even after that.
        prepare: called before the first candidate is solved, if there is any to solve.
        report: writes the folder's page after all other files.
        prove: called for a complete answer with a design; returns the answer with proofs.
        after_size: called after the search of each size, in the time that is left for it.

    Raises:
        BadInput: the folder cannot be used. A read-only folder is accepted if its run is complete.
        KeyboardInterrupt: after Ctrl-C; all results are kept, all files are written, and a note (PEP 678) says so.
        WorkersLost: the engine has no workers left; same as for Ctrl-C.
        LedgerLost: the folder or its ledger disappeared; the error holds what can still be read of the answer.
    """
    try:
        with RunFolder.open(path, request) as folder, detect_loss(folder):
            try:
                searches = dict.fromkeys((folder, folder.answering))  # one, unless defaults were dropped
                plans = [remaining_plan(searched, workers, time_limit) for searched in searches]
                if any(plan.solves for plan in plans) or after_size:
                    prepare()
                tools = Tools(backends, engine, observer, time.monotonic() + time_limit)
                observer.plan(plans[0])
                for searched in attempts(folder, tools):
                    for level, n, size_tools in sizes_of(searched, tools):
                        search_size(level, n, size_tools)
                        for follow in after_size:
                            follow(level, n, size_tools)
                for follow_search in AFTER_SEARCH:
                    follow_search(folder.answering.levels[0], tools)
            except (KeyboardInterrupt, WorkersLost) as stop:
                write_files(folder.answering)
                folder.ledger.require()
                stop.add_note(KEPT)
                raise
            observer.phase(WRITING)
            write_files(folder.answering)
            report(folder.answering)
            folder.ledger.require()
            answer = answer_of(folder.answering)
    except ReadOnlyFolder:
        if (complete := complete_answer(path, request)) is None:
            raise
        answer = complete
    return prove() if prove is not None and answer.best is not None and answer.complete else answer


def attempts(folder: RunFolder, tools: Tools) -> Iterator[RunFolder]:
    """Yield the folder, and if no design holds the defaults of flying tasks, the run that follows (`fallback`)."""
    yield folder
    if not folder.request.task.flight.filled or folder.has_clear or not answer_of(folder).complete:
        return
    rows = (row for level in folder.levels for n in folder.request.task.sizes for row in level.ledger.ranking(n))
    if not any(row.audit_failure is not None for row in rows):
        tools.observer.note("no design holds the defaults of a flying task; the search goes on without them")
        yield folder.fallback


def sizes_of(folder: RunFolder, tools: Tools) -> Iterator[tuple[RunFolder, int, Tools]]:
    """Yield all sizes of a task, or of each level of its goals, smallest first, with their share of the time."""
    for number, level in enumerate(folder.levels):  # one, unless the task has goals
        if level.request.level is not None:
            tools.observer.note(f"level {number} of {len(folder.levels)}: {level.request.level.words}")
        level_tools, sizes = tools.share(len(folder.levels) - number), level.request.task.sizes
        for index, n in enumerate(sizes):
            yield level, n, level_tools.share(len(sizes) - index)


def search_size(folder: RunFolder, n: int, tools: Tools) -> None:
    """Solve the candidates of n modules that are not in the ledger yet, and audit the best."""
    ledger, request = folder.ledger, folder.request
    contexts, quotient = request.contexts(n), request.quotient(n)
    context, bound = contexts[0], ledger.bound(contexts[0])
    if bound is None:
        tools.observer.phase(proof_phase(n))
        bound = tools.backends.lower_bound(context.task), tools.backends.prove_impossible(context.task)
        ledger.add_context(context, *bound)
    lower_bound, impossible = bound
    if not quotient.exact:
        tools.observer.note(quotient_remark(quotient))
    if impossible is not None:
        tools.observer.note(f"{quantity(n, 'module')}: proven impossible, without a search: {impossible.message}")
        record_proof(folder, n, impossible, lower_bound)
        return
    for margin_context in contexts:
        ledger.forget_audit_failures(margin_context)
    if ledger.is_complete(context, request.starts, request.trials) and not ledger.has_failures(context):
        audit_best(folder, n, lower_bound, tools)
        return

    for pruning_bound in (lower_bound, -math.inf) if request.prune else (-math.inf,):
        strategy = STRATEGIES[request.strategy](folder, n, bound=pruning_bound, timed=math.isfinite(tools.until))
        jobs = ProposedJobs(strategy, folder, n, lower_bound, tools.observer)
        with closing(tools.solve(jobs)) as outcomes:
            for job, outcome in outcomes:
                jobs.record(job, outcome)
        audit_best(folder, n, lower_bound, tools)
        if not jobs.is_finished:
            return
        if pruning_bound == -math.inf or record_pruned(folder, n, lower_bound):
            break  # else the design that pruned the others did not pass its audit
    ledger.mark_complete(context, request.starts, request.trials)


def write_files(folder: RunFolder) -> None:
    """Write all files but the ledger and the page.

    Raises:
        BadInput: files of these names exist that the run did not write; all others are written.
    """
    refusals = list[BadInput]()
    writers = [partial(RunFolder.write, level) for level in folder.levels]
    for writer in [*writers, *(partial(write, folder) for write in FILES)]:
        try:
            writer()
        except BadInput as refusal:
            refusals.append(refusal)
    if refusals:
        raise refusals[0]
