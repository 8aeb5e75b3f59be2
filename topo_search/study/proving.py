"""Proofs of all trees of a run, made and checked chunk by chunk.

A chunk that ended is kept within a second, and is not searched again. A check is made by means that share nothing
with the proof; it proves and writes nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from topo_search.engine import AuditDesign, Engine, Failed, WorkersLost, audit_deadline
from topo_search.model import BadInput, CheckedChunk, Chunk, Design, Fault, Proof, ResolvedTask, Topology
from topo_search.model.proof import Aim, Problem, chunk_count
from topo_search.model.proven import gap_percent
from topo_search.study.answer import Answer
from topo_search.study.directory import CHANGED, RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.ledger_file import KEPT
from topo_search.study.progress import EXPECTED, Observer, Phase
from topo_search.study.proofs import IMPOSSIBLE, claim_of, sizes_with_best, target
from topo_search.study.request import Request
from topo_search.study.summary import answer_of, check_designs, refuse_lost

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

    def jobs(self) -> Iterator[tuple[Proof, int]]:
        """Yield what is due, tree by tree; a tree with a chunk that cannot be closed is left alone."""
        for key in list(self.proofs):
            for number in self.proofs[key].due_chunks():
                if self.proofs[key].open_at is None:
                    yield self.proofs[key].without_chunks, number

    def take(self, begun: Proof, number: int, result: Chunk | Failed) -> None:
        """Keep what came of a chunk."""
        key = begun.topology_key
        if begun.cut != self.proofs[key].cut:
            return
        if isinstance(result, Failed):
            self.observer.note(f"{key}: chunk {number} failed, {result.reason}")
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
        refuse_unprovable(folder.request, str(path))
        sizes = sizes_with_best(folder, key, none="has no audited design to prove against")
        try:
            for n, incumbent, best, rows in sizes:
                rows.sort(key=lambda row: row.status == IMPOSSIBLE)  # last: theirs is for the check alone
                impossible = frozenset(row.key for row in rows if row.status == IMPOSSIBLE)
                work = _Work(folder, observer, best * (1 - gap), impossible=impossible)
                task = folder.request.contexts(n)[0].task
                kept, reusable = folder.proofs(n), _lend(lender, task)
                for row in rows:
                    aim, cut = target(row, best, gap)
                    held, reused = kept.get(row.key), reusable.get(row.key)
                    if held is not None and _serves(held, cut, work.floor, gap, problem):
                        if held.open_at is not None and held.cut > work.floor:
                            held = _lower(held, work.floor)
                    elif reused is not None and reused.cut >= work.floor and reused.problem in ("task", problem):
                        whole: Aim = "excluded" if reused.cut >= best else "within"
                        held = reused.model_copy(update={"aim": whole, "gap": gap})
                        work.due.add(row.key)
                    else:
                        scope = {"gap": gap, "problem": problem, "aim": aim, "cut": cut}
                        root = centre(task, Topology.from_key(row.key))
                        held = Proof(task=task, topology_key=row.key, root_module=root, **scope)
                    work.proofs[row.key] = held
                before = dict[str, float]()
                while before != (cuts := {key: proof.cut for key, proof in work.proofs.items()}):
                    before = cuts  # what was lowered meanwhile is due again
                    due = sum(len(proof.due_chunks()) for proof in work.proofs.values() if proof.open_at is None)
                    if due:
                        started_at = time.monotonic()
                        prepare(task)
                        until += time.monotonic() - started_at
                    observer.phase(Phase("proving", n, due, seconds=EXPECTED.chunk_s))
                    search = partial(_search, prove_chunk)
                    ended = engine.run(search, work.jobs(), deadline=lambda _: PATIENCE.chunk_s, until=until)
                    try:
                        for job, result in ended:
                            work.take(*job, result)
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


def _search(prove_chunk: ProveChunk, job: tuple[Proof, int]) -> Chunk:
    """Search a chunk of the tree of a proof (in a worker)."""
    proof, number = job
    return prove_chunk(proof.task, proof.topology, number, proof.cut, proof.problem)


def refuse_unprovable(request: Request, name: str) -> None:
    """Refuse to prove what is beyond a proof, before a search for it begins.

    Raises:
        BadInput: the task has goals, or more modules than a proof can be of; `name` says whose it is.
    """
    _refuse_goals(request, name)
    if request.task.end_effector.rod_mass == "included":
        rule = 'must be "ignored" for a proof, which knows no rod whose mass a design decides, but got "included"'
        raise BadInput(name, [Fault("end_effector.rod_mass", rule)])
    if (n := request.task.sizes[-1]) > PATIENCE.modules:
        raise BadInput(name, [Fault("modules", f"must be at most {PATIENCE.modules} for a proof, but got {n}")])


def _refuse_goals(request: Request, name: str) -> None:
    if request.task.goals.names:
        raise BadInput(name, "has goals: a proof needs a single objective; run the task without goals")


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
    return proof.without_chunks.model_copy(update={"aim": "within", "cut": floor})


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


_CheckJob = tuple[Proof, Chunk]
CheckChunk = Callable[[ResolvedTask, Topology, int, float, Chunk, Problem], CheckedChunk]
"""Checks that no design of one chunk of a tree costs less than a cut [rad^4/s^4]: a pure function."""


@dataclass
class CheckedTree:
    """Result of checking one tree."""

    key: str
    modules: int
    bound: float | None = None
    """No design of the tree costs less, if it is checked and nothing of the run is refused [rad^4/s^4]."""
    problem: Problem = "task"
    """Designs that the bound is about."""
    fault: str | None = None
    """Why its proof is refused."""
    left: str | None = None
    """Why there is nothing to check."""
    boxes: int = 0
    halved: int = 0
    chunks: int = 0
    """That were checked and hold."""

    @property
    def verdict(self) -> str:
        """`checked`, `refused`, `open` or `impossible`."""
        if self.fault is not None:
            return "refused"
        return "checked" if self.left is None else self.left


@dataclass
class Checked:
    """Result of checking a run."""

    trees: list[CheckedTree] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    """One for each size with a best design."""
    faults: list[str] = field(default_factory=list)
    """Faults other than those of single trees."""

    missing: int = 0
    """Number of candidates that the run has not solved yet, unless one tree alone was to be looked at."""

    @property
    def refused(self) -> bool:
        """True if anything is wrong."""
        return bool(self.faults) or any(tree.fault is not None for tree in self.trees)

    @property
    def settled(self) -> bool:
        """True if there is a proof, or another reason, for every tree."""
        return not self.refused and not self.missing and all(tree.left in (None, IMPOSSIBLE) for tree in self.trees)


def check(
    path: Path,
    check_chunk: CheckChunk,
    audit: AuditDesign,
    *,
    key: str | None,
    engine: Engine,
    observer: Observer,
    prepare: Callable[[ResolvedTask], None] = lambda _: None,
) -> Checked:
    """Check the proofs of a run, and the audit of the design that they are against.

    Args:
        path: the run's folder.
        check_chunk: checks a chunk.
        audit: audits a design.
        key: of the one tree to look at; None: all.
        engine: where chunks are checked.
        observer: receives the progress.
        prepare: is called before the first chunk of a task is checked, if any is.

    Raises:
        BadInput: it is not a run folder, has no audited design or no such tree.
        WorkersLost: the engine has no workers any more.
    """
    checked = Checked()
    with RunFolder.load(path) as folder:
        _refuse_goals(folder.request, str(path))
        sizes = sizes_with_best(folder, key, none="holds no audited design that a proof could be against")
        for n, best, _, rows in sizes:
            if not rows:
                continue
            if fault := _best_fault(folder, best, audit, engine):
                checked.faults.append(fault)
            trees, jobs = dict[str, CheckedTree](), list[_CheckJob]()
            for row in rows:
                trees[row.key], proof = _examine(folder, row)
                if proof is not None:
                    jobs += [(proof.without_chunks, chunk) for chunk in proof.chunks]
            if jobs:
                prepare(folder.request.contexts(n)[0].task)
            _replay(jobs, trees, check_chunk, engine, observer)
            checked.trees += trees.values()
        with_trees = {f"{RunFile.PROOFS}/{tree.key}" for tree in checked.trees}  # refused with their trees
        checked.faults += [f"{name} {CHANGED}" for name in folder.changed_files() if name not in with_trees]
        if checked.refused:  # then nothing is claimed, whatever else holds
            for examined in checked.trees:
                examined.bound = None
        for n, best, _, rows in sizes:
            count = folder.request.space(n).count()
            if key is None:
                checked.missing += count - len(rows)
            if len(rows) > 1:
                of_size = [tree for tree in checked.trees if tree.modules == n]
                checked.sentences.append(_sentence(folder, of_size, best, count, proven=not checked.refused))
    return checked


def _examine(folder: RunFolder, row: Row) -> tuple[CheckedTree, Proof | None]:
    """Return what can be said of a tree without checking chunks, and its proof if they are to be checked."""
    tree, name, request = CheckedTree(row.key, row.modules), f"{RunFile.PROOFS}/{row.key}", folder.request
    proof: Proof | None = None
    try:
        if request.space(row.modules).candidate_of(Topology.from_key(row.key)).key != row.key:
            raise ValueError(f"{row.key} is one of several trees that are one candidate")
        proof = folder.read_own(name, Proof)
    except BadInput as error:
        tree.fault = f"{name}{':' if error.faults[0].path else ''} {error.faults[0]}"
    except ValueError:
        tree.fault = "is no candidate of this run"
    if proof is not None:
        tree.fault = _unfit(proof, row.key, request.contexts(row.modules)[0].task)
    if tree.fault is None and (proof is None or not proof.complete):
        open_ = "not examined" if proof is None else "open"
        tree.left = IMPOSSIBLE if row.status == IMPOSSIBLE else open_
    if proof is None or tree.fault is not None or tree.left is not None:
        return tree, None
    tree.bound, tree.problem = proof.cut, proof.problem
    return tree, proof


def _replay(
    jobs: list[_CheckJob],
    trees: dict[str, CheckedTree],
    check_chunk: CheckChunk,
    engine: Engine,
    observer: Observer,
) -> None:
    """Fill in what the chunks come to, and tell of each tree as it ends."""
    due = (job for job in jobs if trees[job[0].topology_key].fault is None)
    note_period_s = 10.0  # between two lines about one tree
    noted_at = time.monotonic()
    ended = engine.run(partial(_check, check_chunk), due, deadline=lambda _: PATIENCE.chunk_s)
    for (proof, chunk), result in ended:
        tree = trees[proof.topology_key]
        if tree.fault is not None:
            continue
        fault = result.reason if isinstance(result, Failed) else result.fault
        if fault is not None:
            tree.fault = f"chunk {chunk.number}: {fault}"
        elif isinstance(result, CheckedChunk):
            tree.boxes, tree.halved = tree.boxes + result.boxes, tree.halved + result.halved
            tree.chunks += 1
        if tree.fault is not None:
            observer.note(f"{tree.key}: refused, {tree.fault}")
        elif tree.chunks == chunk_count(tree.modules):
            halved = f"{tree.halved:,} of them halved further"
            observer.note(f"{tree.key}: checked, {tree.boxes:,} boxes ({halved})")
        elif time.monotonic() - noted_at > note_period_s:
            noted_at = time.monotonic()
            observer.note(f"{tree.key}: {tree.chunks} of {chunk_count(tree.modules)} chunks, {tree.boxes:,} boxes")


def _check(check_chunk: CheckChunk, job: _CheckJob) -> CheckedChunk:
    """Check a chunk of a proof (in a worker)."""
    proof, chunk = job
    return check_chunk(proof.task, proof.topology, proof.root_module, proof.cut, chunk, proof.problem)


def _best_fault(folder: RunFolder, best: Row, audit: AuditDesign, engine: Engine) -> str | None:
    """Say what is wrong with the best design, which proofs are against."""
    n, ledger = best.modules, folder.ledger
    contexts = folder.request.contexts(n)
    try:
        check_designs(ledger, contexts, folder.request.space(n), [best])
        design = Design.model_validate_json(folder.text(best) or "")
    except BadInput as error:
        return str(error)
    verdict = engine.run_one(audit, design, deadline=audit_deadline(n))
    if isinstance(verdict, Failed):
        return f"{best.key}: the audit of the best design failed: {verdict.reason}"
    return None if verdict.verdict == "clear" else f"{best.key}: the audit of the best design is {verdict.verdict}"


def _unfit(proof: Proof, key: str, task: ResolvedTask) -> str | None:
    """Say why a proof is none of this tree and task."""
    if proof.topology_key != key:
        return f"{RunFile.PROOFS}/{key} is the proof of another tree, {proof.topology_key}"
    if proof.task != task:
        return f"{RunFile.PROOFS}/{key} is about another task"
    numbers = [chunk.number for chunk in proof.chunks]
    if len(set(numbers)) < len(numbers):
        return f"{RunFile.PROOFS}/{key} has a chunk twice"
    return None


def _sentence(folder: RunFolder, trees: list[CheckedTree], best: Row, candidates: int, *, proven: bool) -> str:
    """Say what the checked proofs of one size come to; `proven`: nothing of the run is refused."""
    done = [tree for tree in trees if tree.verdict == "checked"]
    counts = {word: sum(tree.verdict == word for tree in trees) for word in ("refused", "open", "not examined")}
    counts["not examined"] += candidates - len(trees)
    left = [f"{number} {word}" for word, number in counts.items() if number]
    impossible = sum(tree.verdict == IMPOSSIBLE for tree in trees)
    beside = f", {impossible} said to be impossible, which is not checked" if impossible else ""
    if left or not proven:
        return ", ".join([f"{len(done)} of {candidates} trees checked", *left]) + beside
    bounds = [tree.bound for tree in done if tree.bound is not None]
    _, claim, scope = claim_of(folder, best, bounds, [tree.problem for tree in done])
    return f"checked: {claim} than {best.key} ({len(done)} of {candidates} trees{beside}); {scope}"
