"""A run, from a request to its answer: sizes smallest first, every candidate in the ledger as it ends."""

from __future__ import annotations

import math
import os
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path

from topo_search.engine import Backends, Engine, TimeUp, WorkersLost, exhaustive_search
from topo_search.model import Audit, BadInput, Design, Infeasible
from topo_search.study.answer import Answer, LevelAnswer, SizeAnswer, proven_statement, quotient_remark, size_answer
from topo_search.study.audits import audit_best, audits_left
from topo_search.study.directory import ReadOnlyFolder
from topo_search.study.folder import LEDGER, RunFolder
from topo_search.study.front import front_of, write_front
from topo_search.study.ledger import Ledger
from topo_search.study.ledger_file import KEPT, LedgerLost, parse
from topo_search.study.progress import WRITING, Observer, proof_phase, remaining_plan
from topo_search.study.proofs import subject_of, summarize
from topo_search.study.relaxing import causes, find_causes
from topo_search.study.request import Context, Request
from topo_search.study.row import row_of
from topo_search.study.solving import RecordedSolver, record_pruned, rests_on_an_audited_design
from topo_search.study.summary import check_designs, check_rows

MOST_ROWS_OF_A_PROOF = 100_000
"""A proof holds for every candidate; beyond this number they are not written one by one."""


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
) -> Answer:
    """Do what is still to be done of a run, and return its answer.

    Args:
        request: what is asked.
        path: the run's folder; made if there is none, taken up again if there is.
        backends: solver, audit and bounds.
        engine: where jobs run; it changes nothing but the time it takes.
        observer: is told of the progress.
        workers: how many jobs the engine runs at a time; None where that is not known.
        time_limit: seconds after which no more is solved, from the end of `prepare`; the best designs are audited
            all the same.
        prepare: is called before the first candidate is solved, if any is.
        report: is handed the folder once all its files are written.

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
                if plan.solves:
                    prepare()
                until = time.monotonic() + time_limit
                observer.plan(plan)
                for number, level in enumerate(folder.levels()):
                    left = len(request.levels) - number
                    if level.request.level is not None:
                        observer.note(f"level {number} of {len(request.levels)}: {level.request.level.words}")
                    _search_level(level, backends, engine, observer, _share(until, left))
                find_causes(next(folder.levels()), backends, engine, observer, until)
            except (KeyboardInterrupt, WorkersLost) as stop:
                _write(folder)
                folder.ledger.require()
                stop.add_note(KEPT)
                raise
            observer.phase(WRITING)
            _write(folder)
            report(folder)
            folder.ledger.require()
            return answer_of(folder)
    except ReadOnlyFolder:
        answer = _finished_answer(path, request)
        if answer is None:
            raise
        return answer


@contextmanager
def refuse_lost(folder: RunFolder) -> Iterator[None]:
    """Say that folder or ledger are gone, if that is what ended the run, and what can still be read of them."""
    try:
        yield
    except (LedgerLost, OSError, sqlite3.Error, BadInput) as error:
        try:
            folder.ledger.require()
        except LedgerLost as lost:
            with suppress(OSError, sqlite3.Error, BadInput):  # the file is open, but may be empty
                lost.answer = answer_of(folder)
                lost.design = lost.answer.design or _best_unaudited(folder)
            raise lost from error
        raise


def _share(until: float, parts: int) -> float:
    """Return when the first of so many equal parts of the time that is left is over."""
    now = time.monotonic()
    return until if parts == 1 else now + (until - now) / parts


def _search_level(folder: RunFolder, backends: Backends, engine: Engine, observer: Observer, until: float) -> None:
    """Search all sizes of a task without goals."""
    sizes = folder.request.task.sizes
    for number, n in enumerate(sizes):
        _search_size(folder, n, backends, engine, observer, _share(until, len(sizes) - number))


def _write(folder: RunFolder) -> None:
    """Write all files but the ledger and the page."""
    for level in folder.levels():
        level.write()
    if folder.request.task.goals.names:
        write_front(folder)


def _search_size(
    folder: RunFolder,
    n: int,
    backends: Backends,
    engine: Engine,
    observer: Observer,
    until: float,
) -> None:
    """Solve the candidates of one size that are not in the ledger yet, and audit the best."""
    ledger, request = folder.ledger, folder.request
    contexts = request.contexts(n)
    context = contexts[0]
    bound = ledger.bound(context)
    if bound is None:
        observer.phase(proof_phase(n))
        bound = backends.lower_bound(context.task), backends.prove_impossible(context.task)
        ledger.begin(context, *bound)
    lower_bound, proof = bound
    quotient = request.quotient(n)
    if not quotient.exact:
        observer.note(quotient_remark(quotient))
    if proof is not None:
        _record_proof(ledger, request, context, proof, lower_bound)
        return

    def audit() -> None:
        audit_best(
            ledger,
            contexts,
            backends,
            engine,
            starts=request.starts,
            lower_bound=lower_bound,
            observer=observer,
            until=until,
            near=request.near,
        )

    for each in contexts:
        ledger.forget_audit_failures(each)
    if ledger.has_ended(context, request.starts, request.trials) and not ledger.has_failures(context):
        audit()
        return
    previous = None if request.previous is None else request.previous.contexts(n)[0]

    def solve(bound: float | None) -> bool:
        solver = RecordedSolver(
            ledger, context, lower_bound, backends.solve, engine, observer, previous, request.near, until
        )
        with closing(solver):
            return _follow_strategy(solver, folder, n, bound, timed=math.isfinite(until))

    ended = solve(lower_bound if request.prune else None)
    audit()
    if ended and request.prune:
        if rests_on_an_audited_design(ledger, n, lower_bound):
            record_pruned(ledger, context, request.space(n), lower_bound)
        else:
            ended = solve(None)
            audit()
    if ended:
        ledger.end(context, request.starts, request.trials)


def _follow_strategy(
    solver: RecordedSolver, folder: RunFolder, n: int, bound: float | None, *, timed: bool
) -> bool:
    """Search the trees of n modules, and return whether the search came to its end in time.

    Args:
        solver: solves the candidates.
        folder: of the run.
        n: number of modules.
        bound: of every candidate's objective; None: nothing is pruned.
        timed: whether there is a time limit.
    """
    request = folder.request
    space = request.space(n)
    try:
        if request.strategy == "exhaustive":
            least = None if bound is None else lambda _: bound
            exhaustive_search(solver, space, starts=request.starts, timed=timed, bound=least)
        else:
            from topo_search.engine.proposals import optuna_search  # loads Optuna

            optuna_search(
                solver,
                space,
                sampler=request.propose or request.sampler,
                trials=space.count() if request.trials is None else request.trials,
                round_size=request.round_size,
                starts=request.starts,
                seed=request.seed,
                journal=folder.journal(f"study-n{n}.journal"),
                timed=timed,
            )
    except TimeUp:
        return False
    return True


def _record_proof(
    ledger: Ledger, request: Request, context: Context, proof: Infeasible, lower_bound: float
) -> None:
    """Write a row for every candidate that a proof rules out."""
    n = context.task.n
    space = request.space(n)
    if space.count() > MOST_ROWS_OF_A_PROOF:
        return
    candidates = space.candidates()
    while batch := list(islice(candidates, 1000)):
        rows = [
            row_of(
                proof,
                key=candidate.key,
                modules=n,
                orbit=candidate.orbit,
                asked=request.starts,
                lower_bound=lower_bound,
            )
            for candidate in batch
        ]
        ledger.record(context, [(row, None) for row in rows])


def _finished_answer(path: Path, request: Request) -> Answer | None:
    """Return the answer of a run that has nothing left to do, from a folder that cannot be written to."""
    if not os.access(path / LEDGER, os.R_OK):
        return None
    with RunFolder.read(path, request) as folder:
        answer = answer_of(folder)
    return answer if answer.complete else None


def answer_of(folder: RunFolder) -> Answer:
    """Return what a run has found, from its ledger."""
    goals = folder.request.task.goals
    sizes = [_sizes(level) for level in folder.levels()]
    answer = Answer(folder.path, sizes[0])
    if goals.names:
        found = enumerate(zip(goals.levels, sizes, strict=True))
        answer = replace(answer, levels=tuple(LevelAnswer(k, *one) for k, one in found), points=front_of(folder))
    if answer.best is None:
        return answer
    number = answer.points[0].number if answer.points else 0
    request = next(islice(folder.levels(), number, None)).request
    context, ledger = request.contexts(answer.best.modules)[answer.best.step], folder.ledger
    design, text = ledger.result(context, answer.best.key), ledger.audit(context, answer.best.key)
    audit = None if text is None else parse(ledger.path, Audit, "texts", text, strict=False)
    return replace(answer, design=design if isinstance(design, Design) else None, audit=audit)


def _best_unaudited(folder: RunFolder) -> Design | None:
    """Return the design of least effort of the smallest size that has any, whatever is known of its audit."""
    for level in folder.levels():
        for n in level.request.task.sizes:
            for row in islice(level.ledger.ranking(n), 1):
                found = level.ledger.result(level.request.contexts(n)[row.step], row.key)
                if isinstance(found, Design):
                    return found
    return None


def _sizes(folder: RunFolder) -> tuple[SizeAnswer, ...]:
    """Read the answer of a task without goals."""
    found = (_add_proof(folder, _sum_up(folder.ledger, folder.request, n)) for n in folder.request.task.sizes)
    return tuple(size if size.feasible else replace(size, relaxed=causes(folder, size.modules)) for size in found)


def _add_proof(folder: RunFolder, answer: SizeAnswer) -> SizeAnswer:
    """Return the answer of one size with what branch and bound proves of it."""
    proofs = folder.proofs(answer.modules)
    if not proofs:
        return answer
    task, rows = folder.request.contexts(answer.modules)[0].task, list(folder.ledger.ranking(answer.modules))
    whom = subject_of(folder.request, answer.modules)
    found = summarize(rows, proofs, answer.best, task, answer.candidates, whom)
    told = answer.statement
    if found.gap is not None:
        told = proven_statement(answer.candidates, found.gap)
    of_size = found.gap if answer.covers_size else None
    return replace(
        answer,
        statement=told,
        proven=found.sentence,
        candidates_gap=found.gap,
        proven_gap=of_size,
        proof_resumable=found.resumable,
    )


def _sum_up(ledger: Ledger, request: Request, n: int) -> SizeAnswer:
    """Read the answer of one size from the ledger."""
    contexts, space = request.contexts(n), request.space(n)
    lower_bound, proof = ledger.bound(contexts[0]) or (0.0, None)
    answer = size_answer(
        check_rows(ledger.ranking(n), space, lower_bound, ledger.path),
        contexts[0].task,
        candidates=space.count(),
        starts=request.starts,
        ended=proof is not None or ledger.has_ended(contexts[0], request.starts, request.trials),
        audits_left=audits_left(ledger, contexts, request.starts),
        lower_bound=lower_bound,
        proof=proof,
        quotient=request.quotient(n),
        covers=request.covers(n),
    )
    best = [] if answer.best is None or answer.best in answer.top else [answer.best]
    check_designs(ledger, contexts, space, [*answer.top, *best])
    return answer
