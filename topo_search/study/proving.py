"""Proofs of all trees of a run, chunk by chunk: what ended is kept within a second, and is not searched again."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from topo_search.engine import Engine, Failed, WorkersLost
from topo_search.model import BadInput, Chunk, Fault, Proof, ResolvedTask, Topology
from topo_search.model.proof import Aim, Problem
from topo_search.model.proven import gap_percent
from topo_search.study.answer import Answer
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.ledger_file import KEPT
from topo_search.study.progress import EXPECTED, Observer, Phase
from topo_search.study.proofs import IMPOSSIBLE, NO_GOALS, sizes_with_best, target
from topo_search.study.request import Request
from topo_search.study.summary import answer_of, refuse_lost

ProveChunk = Callable[[ResolvedTask, Topology, int, float, Problem], Chunk]
"""Searches one chunk of a tree for designs under a cut [rad^4/s^4]: a pure function."""


@dataclass(frozen=True)
class Patience:
    """Limits of a proof that keep it from taking too long."""

    chunk_s: float = 7200.0
    """After which a chunk counts as hung: far above what one takes (n = 5: seconds)."""
    modules: int = 12
    """The allowance for rounding holds for more (`nlp.bounds.branch.box`); nobody can wait for so many boxes."""
    write_period_s: float = 1.0
    """Least time between two writes of a proof that is not complete."""


PATIENCE = Patience()


@dataclass(frozen=True)
class _Job:
    """One chunk of one tree."""

    task: ResolvedTask
    topology: Topology
    number: int
    cut: float
    problem: Problem


@dataclass
class _Work:
    """The proofs of one size, as they grow."""

    folder: RunFolder
    observer: Observer
    floor: float
    """Cut for a tree that cannot be held to a higher one: `gap` under the run's best [rad^4/s^4]."""
    proofs: dict[str, Proof] = field(default_factory=dict)
    kept: float = 0.0
    due: set[str] = field(default_factory=set)
    """Proofs with chunks that are not written yet."""
    impossible: frozenset[str] = frozenset()
    """Trees that other rules prove impossible; a record is for `--check` alone."""

    def jobs(self) -> Iterator[_Job]:
        """Yield what is due, tree by tree; a tree with a chunk that cannot be closed is left alone."""
        for key in list(self.proofs):
            for number in self.proofs[key].due_chunks():
                proof = self.proofs[key]
                if proof.open_at is None:
                    yield _Job(proof.task, proof.topology, number, proof.cut, proof.problem)

    def take(self, job: _Job, result: Chunk | Failed) -> None:
        """Keep what came of a chunk."""
        key = job.topology.key
        if job.cut != self.proofs[key].cut:
            return
        if isinstance(result, Failed):
            self.observer.note(f"{key}: chunk {job.number} failed, {result.reason}")
            return
        known_open = self.proofs[key].open_at is not None
        proof = self.proofs[key] = self.proofs[key].with_chunk(result)
        self.due.add(key)
        if proof.complete or time.monotonic() - self.kept > PATIENCE.write_period_s:
            self.keep()
        if proof.complete:
            self.observer.note(f"{key}: {_words(proof, self.floor)}, {proof.boxes:,} boxes")
        elif result.outcome != "closed" and proof.cut > self.floor:
            self.proofs[key] = _lower(proof, self.floor)
            self.observer.note(f"{key}: {_cause(result)}; proving a gap of {gap_percent(proof.gap)} instead")
        elif result.outcome != "closed" and not known_open:
            state = "impossible, but without a record to check" if key in self.impossible else "open"
            self.observer.note(f"{key}: {state}, for {_cause(result)}")

    def keep(self) -> None:
        """Write what is not written yet."""
        for key in sorted(self.due):
            self.folder.keep_proof(self.proofs[key])
        self.due.clear()
        self.kept = time.monotonic()


def prove(
    path: Path,
    prove_chunk: ProveChunk,
    centre: Callable[[ResolvedTask, Topology], int],
    *,
    gap: float,
    key: str | None = None,
    engine: Engine,
    observer: Observer,
    problem: Problem = "task",
    lender: Path | None = None,
    time_limit: float = math.inf,
    prepare: Callable[[ResolvedTask], None] = lambda _: None,
    report: Callable[[RunFolder], None] = lambda _: None,
) -> Answer:
    """Prove what can be proven of the trees of a run against its best audited design, and return its answer.

    Args:
        path: the run's folder.
        prove_chunk: the prover.
        centre: which module a tree hangs from in a proof.
        gap: share of its own best effort to which a tree is proven that cannot be excluded.
        key: of the one tree to look at; None: all.
        engine: where chunks are searched; it changes nothing but the time it takes.
        observer: receives the progress.
        problem: which designs the proof is about; what is proven of the task's is not proven again of the solver's.
        lender: folder of another run, whose proofs are taken where they hold for this one and prove as much as the
            gap asks for.
        time_limit: seconds after which no more is searched; `prepare` does not count.
        prepare: is called before the first chunk of a task is searched, if any is.
        report: is handed the folder once all its files are written.

    Raises:
        BadInput: it is not a run folder, has no audited design or no such tree, or another process works in it; no
            proof of the other run holds for it.
        KeyboardInterrupt: after Ctrl-C, with every finished chunk kept.
        WorkersLost: the engine has no workers any more; likewise.
        LedgerLost: as of `run`.
    """
    until = time.monotonic() + time_limit
    with RunFolder.load(path, writes=True) as folder, refuse_lost(folder):
        sizes = _sizes(folder, path, key)
        try:
            for n, incumbent, best, rows in sizes:
                impossible = frozenset(row.key for row in rows if row.status == IMPOSSIBLE)
                work = _Work(folder, observer, best * (1 - gap), impossible=impossible)
                task = folder.request.contexts(n)[0].task
                kept, reusable = folder.proofs(n), _lend(lender, task)
                for row in rows:
                    aim, cut = target(row, best, gap)
                    held = kept.get(row.key)
                    reused = reusable.get(row.key)
                    if held is not None and _serves(held, cut, work.floor, gap, problem):
                        if held.open_at is not None and held.cut > work.floor:
                            held = _lower(held, work.floor)
                    elif reused is not None and reused.cut >= work.floor and reused.problem in ("task", problem):
                        whole: Aim = "excluded" if reused.cut >= best else "within"
                        held = reused.model_copy(update={"aim": whole, "gap": gap})
                        work.due.add(row.key)
                    else:
                        root = centre(task, Topology.from_key(row.key))
                        held = Proof(
                            task=task,
                            topology_key=row.key,
                            root_module=root,
                            aim=aim,
                            gap=gap,
                            problem=problem,
                            cut=cut,
                        )
                    work.proofs[row.key] = held
                before = dict[str, float]()
                while before != (cuts := {key: proof.cut for key, proof in work.proofs.items()}):
                    before = cuts  # what was lowered meanwhile is due again
                    due = sum(
                        len(list(proof.due_chunks())) for proof in work.proofs.values() if proof.open_at is None
                    )
                    if due:
                        started_at = time.monotonic()
                        prepare(task)
                        until += time.monotonic() - started_at
                    observer.phase(Phase("proving", n, due, seconds=EXPECTED.chunk_s))
                    ended = engine.run(
                        partial(_prove, prove_chunk), work.jobs(), deadline=lambda _: PATIENCE.chunk_s, until=until
                    )
                    try:
                        for job, result in ended:
                            work.take(job, result)
                            observer.settled(incumbent)
                    finally:
                        work.keep()
        except (KeyboardInterrupt, WorkersLost) as stop:
            folder.write()
            stop.add_note(KEPT)
            raise
        folder.write()
        report(folder)
        folder.ledger.require()
        return answer_of(folder)


def refuse_unprovable(request: Request, name: str) -> None:
    """Refuse to prove what is beyond a proof, before a search for it begins.

    Raises:
        BadInput: the task has goals, or more modules than a proof can be of; `name` says whose it is.
    """
    if request.task.goals.names:
        raise BadInput(name, NO_GOALS)
    if request.task.end_effector.rod_mass == "included":
        rule = 'must be "ignored" for a proof, which knows no rod whose mass a design decides, but got "included"'
        raise BadInput(name, [Fault("end_effector.rod_mass", rule)])
    if (n := request.task.sizes[-1]) > PATIENCE.modules:
        raise BadInput(name, [Fault("modules", f"must be at most {PATIENCE.modules} for a proof, but got {n}")])


def _serves(held: Proof, cut: float, floor: float, gap: float, problem: Problem) -> bool:
    """True if what is held of a tree is what is asked for, or more, a part of it, or all that this gap led to."""
    if held.complete:
        enough = held.cut >= cut or (held.gap == gap and held.cut >= floor)
        return enough and held.problem in ("task", problem)
    return held.cut in (cut, floor) and held.problem == problem


def _lend(lender: Path | None, task: ResolvedTask) -> dict[str, Proof]:
    """Return the proofs of another run that hold for a task."""
    if lender is None:
        return {}
    with RunFolder.load(lender) as other:
        proofs = other.proofs_for(task)
    if not proofs:
        text = f"has no complete proof that holds for {task.name}, n = {task.n}: only name and exposure may differ"
        raise BadInput(str(lender), text)
    return proofs


def _lower(proof: Proof, floor: float) -> Proof:
    return proof.model_copy(update={"aim": "within", "cut": floor, "chunks": ()})


def _prove(prove_chunk: ProveChunk, job: _Job) -> Chunk:
    return prove_chunk(job.task, job.topology, job.number, job.cut, job.problem)


def _sizes(folder: RunFolder, path: Path, key: str | None) -> list[tuple[int, Row, float, list[Row]]]:
    """Return size, best design, its effort, and trees to prove of every size that has a best design."""
    refuse_unprovable(folder.request, str(path))
    sizes, known = sizes_with_best(folder, key)
    if not known:
        raise BadInput(str(path), f"has no candidate {key}")
    provable = [(n, best, best.objective, rows) for n, best, rows in sizes if best.objective]
    if not provable:
        raise BadInput(str(path), "has no audited design to prove against")
    for *_, rows in provable:
        rows.sort(key=lambda row: row.status == IMPOSSIBLE)  # last: theirs is for the check alone
    return provable


def _words(proof: Proof, floor: float) -> str:
    """Say what a complete proof proves."""
    if proof.aim == "excluded":
        return "proven, cannot beat the best"
    whose = "the" if proof.cut == floor else "its own"
    return f"proven, cannot beat {whose} best by more than {gap_percent(proof.gap)}"


def _cause(chunk: Chunk) -> str:
    """Say why a chunk is open."""
    if chunk.outcome == "many":
        return f"chunk {chunk.number} needs more than {chunk.boxes:,} boxes"
    return f"chunk {chunk.number} cannot exclude a better design at the smallest size of boxes"
