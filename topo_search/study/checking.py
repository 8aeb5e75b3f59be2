"""Checks the proofs of a run by means that share nothing with what made them; proves and writes nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from topo_search.engine import AuditDesign, Engine, Failed, Space, audit_deadline
from topo_search.model import BadInput, CheckedChunk, Chunk, Design, Proof, ResolvedTask, Topology
from topo_search.model.bad_input import faults_of
from topo_search.model.proof import Problem, chunk_count
from topo_search.model.proven import improvement
from topo_search.study.directory import CHANGED, RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.progress import Observer
from topo_search.study.proofs import IMPOSSIBLE, NO_GOALS, problem, sizes_with_best, subject_of, weakest_problem
from topo_search.study.summary import check_designs

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


@dataclass(frozen=True)
class _Job:
    task: ResolvedTask
    topology: Topology
    root: int
    cut: float
    chunk: Chunk
    problem: Problem


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
        if folder.request.task.goals.names:
            raise BadInput(str(path), NO_GOALS)
        sizes, known = sizes_with_best(folder, key)
        results = list[tuple[int, Row, ResolvedTask, list[CheckedTree]]]()
        for n, best, rows in sizes:
            if not rows:
                continue
            if fault := _best_fault(folder, best, audit, engine):
                checked.faults.append(fault)
            task, space = folder.request.contexts(n)[0].task, folder.request.space(n)
            trees, jobs = dict[str, CheckedTree](), list[_Job]()
            for row in rows:
                trees[row.key], proof = _examine(folder, row, task, space)
                if proof is not None:
                    tree = proof.topology, proof.root_module, proof.cut
                    jobs += [_Job(task, *tree, chunk, proof.problem) for chunk in proof.chunks]
            if jobs:
                prepare(task)
            _replay(jobs, trees, check_chunk, engine, observer)
            checked.trees += trees.values()
            results.append((n, best, task, list(trees.values())))
        with_trees = {f"{RunFile.PROOFS}/{tree.key}" for tree in checked.trees}  # refused with their trees
        checked.faults += [f"{name} {CHANGED}" for name in folder.changed_files() if name not in with_trees]
        if checked.refused:  # then nothing is claimed, whatever else holds
            for examined in checked.trees:
                examined.bound = None
        for n, best, task, of_size in results:
            count = folder.request.space(n).count()
            if key is None:
                checked.missing += count - len(of_size)
            if len(of_size) > 1:
                subject = subject_of(folder.request, n)
                checked.sentences.append(_sentence(of_size, best, task, count, subject, proven=not checked.refused))
    if not sizes:
        raise BadInput(str(path), "holds no audited design that a proof could be against")
    if not known:
        raise BadInput(str(path), f"has no candidate {key}")
    return checked


def _examine(folder: RunFolder, row: Row, task: ResolvedTask, space: Space) -> tuple[CheckedTree, Proof | None]:
    """Return what can be said of a tree without checking chunks, and its proof if they are to be checked."""
    tree = CheckedTree(row.key, row.modules)
    try:
        is_candidate = space.candidate_of(Topology.from_key(row.key)).key == row.key
    except ValueError:
        is_candidate = False
    if not is_candidate:
        tree.fault = "is no candidate of this run"
        return tree, None
    try:
        content = folder.proof_text(row.key)
        if content is None:
            tree.left = IMPOSSIBLE if row.status == IMPOSSIBLE else "not examined"
            return tree, None
        proof = Proof.model_validate_json(content)
    except BadInput as error:
        tree.fault = f"{RunFile.PROOFS}/{row.key} {error.faults[0].rule}"
        return tree, None
    except ValidationError as error:
        tree.fault = f"{RunFile.PROOFS}/{row.key}: {faults_of(error, Proof)[0]}"
        return tree, None
    tree.fault = _unfit(proof, row.key, task)
    if tree.fault is None and not proof.complete:
        tree.left = IMPOSSIBLE if row.status == IMPOSSIBLE else "open"
    if tree.fault is not None or tree.left is not None:
        return tree, None
    tree.bound, tree.problem = proof.cut, proof.problem
    return tree, proof


def _replay(
    jobs: list[_Job], trees: dict[str, CheckedTree], check_chunk: CheckChunk, engine: Engine, observer: Observer
) -> None:
    """Fill in what the chunks come to, and tell of each tree as it ends."""
    due = (job for job in jobs if trees[job.topology.key].fault is None)
    hung_after_s, note_period_s = 7200.0, 10.0  # of one chunk; between two lines about one tree
    noted_at = time.monotonic()
    for job, result in engine.run(partial(_check, check_chunk), due, deadline=lambda _: hung_after_s):
        tree = trees[job.topology.key]
        if tree.fault is not None:
            continue
        fault = result.reason if isinstance(result, Failed) else result.fault
        if fault is not None:
            tree.fault = f"chunk {job.chunk.number}: {fault}"
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


def _check(check_chunk: CheckChunk, job: _Job) -> CheckedChunk:
    return check_chunk(job.task, job.topology, job.root, job.cut, job.chunk, job.problem)


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


def _sentence(
    trees: list[CheckedTree], best: Row, task: ResolvedTask, candidates: int, subject: str, *, proven: bool
) -> str:
    """Say what the checked proofs of one size come to; `proven`: nothing of the run is refused."""
    done = [tree for tree in trees if tree.verdict == "checked"]
    counts = {word: sum(tree.verdict == word for tree in trees) for word in ("refused", "open", "not examined")}
    counts["not examined"] += candidates - len(trees)
    left = [f"{number} {word}" for word, number in counts.items() if number]
    impossible = sum(tree.verdict == IMPOSSIBLE for tree in trees)
    beside = f", {impossible} said to be impossible, which is not checked" if impossible else ""
    if left or not proven or best.objective is None:
        return ", ".join([f"{len(done)} of {candidates} trees checked", *left]) + beside
    least = min([tree.bound for tree in done if tree.bound is not None], default=best.objective)
    gap = max(0.0, 1 - least / best.objective)
    return (
        f"checked: {subject} is {improvement(gap)} than {best.key} ({len(done)} of {candidates} trees"
        f"{beside}); {problem(task, weakest_problem([tree.problem for tree in done]))}"
    )
