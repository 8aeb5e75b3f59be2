"""Proving and checking all trees of a run, chunk by chunk.

A finished chunk is written within a second and never searched again. The check shares no code with the proof; it
proves nothing and writes nothing.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from topo_search.engine import Candidates, Engine, Failed, Job, WorkersLost
from topo_search.engine.workers import AuditDesign, audit_deadline
from topo_search.model import CheckedChunk, Chunk, Design, Infeasible, Proof, ResolvedTask, Topology
from topo_search.model.files import to_json
from topo_search.model.largest_value import objective_of
from topo_search.model.maximized import provable_at, task_at
from topo_search.model.objective import LEAST_EFFORT, Objective
from topo_search.model.proof import Aim, Problem, chunk_count, most_effort
from topo_search.model.proven import gap_percent, lower_text, upper_text
from topo_search.model.value import BadInput, Fault
from topo_search.study import proofs
from topo_search.study.answer import Answer
from topo_search.study.answering import answer_of, detect_loss
from topo_search.study.directory import CHANGED, RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.ledger_file import KEPT
from topo_search.study.progress import EXPECTED, Observer, Phase
from topo_search.study.request import Request
from topo_search.study.tables import write_candidates

ProveChunk = Callable[[ResolvedTask, Topology, int, float, Problem], Chunk]
"""Pure function that searches one chunk of a tree for designs below a cut [rad^4/s^4]."""


@dataclass(frozen=True)
class ProofLimits:
    """Limits of a proof."""

    chunk_s: float = 7200.0
    """Time after which a chunk counts as hung [s]: far above the typical time (n = 5: seconds)."""
    modules: int = 12
    """Largest platform: more modules take too many boxes, although the prover's rounding allowance covers them."""
    write_period_s: float = 1.0
    """Shortest time between two writes of an incomplete proof [s]."""


PROOF_LIMITS = ProofLimits()


@dataclass
class _SizeProofs:
    """The growing proofs of one size."""

    folder: RunFolder
    observer: Observer
    floor: float
    """Lowest level: `gap` under the run's best effort, or the negative of the value `gap` above its best."""
    proofs: dict[str, Proof] = field(default_factory=dict)
    complete: dict[str, Proof] = field(default_factory=dict)
    """Complete proofs at the start; each stays until a better one is complete."""
    written_at: float = 0.0
    unwritten: set[str] = field(default_factory=set)
    """Keys of the proofs with chunks that are not written yet."""
    impossible: frozenset[str] = frozenset()
    """Trees that other rules prove impossible; only `--check` uses their proofs."""

    def jobs(self) -> Iterator[tuple[Proof, int]]:
        """Yield the chunks to search, tree by tree, skipping trees with a chunk that cannot be closed."""
        for key in list(self.proofs):
            for number in self.proofs[key].due_chunks():
                if self.proofs[key].open_at is None:
                    yield self.proofs[key].without_chunks, number

    def add_result(self, job_proof: Proof, number: int, result: Chunk | Failed) -> None:
        """Add the result of a chunk to its proof, unless the cut was lowered meanwhile."""
        key = job_proof.topology_key
        if job_proof.cut != self.proofs[key].cut:
            return
        if isinstance(result, Failed):
            self.observer.note(f"{key}: chunk {number} failed, {result.reason}")
            return
        was_open = self.proofs[key].open_at is not None
        proof = self.proofs[key] = self.proofs[key].with_chunk(result)
        self.unwritten.add(key)
        if proof.complete or time.monotonic() - self.written_at > PROOF_LIMITS.write_period_s:
            self.write()
        if proof.complete:
            self.observer.note(f"{key}: {_claim(proof, self.floor)}, {proof.boxes:,} boxes")
        elif result.outcome != "closed" and self.can_lower(proof):
            self.proofs[key] = _lower(proof, self.floor)
            self.observer.note(f"{key}: {_cause(result)}; proving a gap of {gap_percent(proof.gap)} instead")
        elif result.outcome != "closed" and not was_open:
            state = "impossible, but without a proof to check" if key in self.impossible else "open"
            if key in self.complete:
                claim = objective_of(proof.task).claim(self.complete[key].bound)
                state = f"no more than before is proven ({claim})"
            self.observer.note(f"{key}: {state}: {_cause(result)}")

    def can_lower(self, proof: Proof) -> bool:
        """True if a proof at the lowest cut would show more than what is complete."""
        return proof.level > self.floor and self.gains(_lower(proof, self.floor))

    def gains(self, proof: Proof) -> bool:
        """True if a proof, once complete, shows more than the one that is complete."""
        complete = self.complete.get(proof.topology_key)
        return complete is None or not _shows(complete, proof.level, proof.problem)

    @property
    def open_trees(self) -> tuple[str, ...]:
        """Keys of the trees for which less is proven than requested."""
        incomplete = [proof for proof in self.proofs.values() if not proof.complete]
        # a proof that is stuck at a higher cut was not lowered: the lowest one is proven
        open_keys = (p.topology_key for p in incomplete if p.open_at is None or p.level <= self.floor)
        return tuple(key for key in open_keys if key not in self.impossible)

    def write(self) -> None:
        """Write the proofs that have new chunks: beside a complete one until they are complete."""
        for key in sorted(self.unwritten):
            proof, unfinished = self.proofs[key], f"{RunFile.UNFINISHED}/{key}"
            if proof.complete or key not in self.complete:
                self.folder.write_file(f"{RunFile.PROOFS}/{key}", to_json(proof))
                self.folder.write_file(unfinished, None)
            else:
                self.folder.write_file(unfinished, to_json(proof))
        self.unwritten.clear()
        self.written_at = time.monotonic()


def prove(
    path: Path,
    prove_chunk: ProveChunk,
    centre: Callable[[ResolvedTask, Topology], int],
    solve: Callable[[Job], Design | Infeasible],
    *,
    gap: float,
    key: str | None = None,
    engine: Engine,
    observer: Observer,
    problem: Problem = "task",
    source_run: Path | None = None,
    time_limit: float = math.inf,
    prepare: Callable[[ResolvedTask], None] = lambda _: None,
    report: Callable[[RunFolder], None] = lambda _: None,
) -> Answer:
    """Prove how far each tree of a run can beat its best audited design, and return the run's answer.

    Args:
        path: the run's folder.
        prove_chunk: the prover.
        centre: returns the module that is the root of a tree in its proof.
        solve: the solver, which says what gap is within reach if the rod has mass.
        gap: share of its own best effort to which a tree is proven if it cannot be excluded.
        key: key of the only tree to prove; None: all.
        engine: runs the jobs; affects only the time.
        observer: receives the progress.
        problem: designs that the proof covers; a proof about the task also counts for the solver's problem.
        source_run: folder of another run, whose proofs are reused where they hold for this run and its gap.
        time_limit: seconds after which the search stops, not counting `prepare`.
        prepare: called before the first chunk of a task is searched, if there is any to search.
        report: writes the folder's page after all other files.

    Raises:
        BadInput: it is not a run folder, has no audited design or no such tree, or another process uses it; or no
            proof of the other run holds for it.
        KeyboardInterrupt: after Ctrl-C; every finished chunk is kept.
        WorkersLost: the engine has no workers left; same as for Ctrl-C.
        LedgerLost: same as in `run`.
    """
    until = time.monotonic() + time_limit
    with RunFolder.load(path, writes=True) as folder, detect_loss(folder):
        refuse_unprovable(folder.request, str(path))
        sizes = proofs.sizes_with_best(folder, key)
        open_trees = dict[int, tuple[str, ...]]()
        try:
            for n, incumbent, best, rows in sizes:
                rows.sort(key=lambda row: row.status == "impossible")  # last: only `--check` uses their proofs
                impossible = frozenset(row.key for row in rows if row.status == "impossible")
                task = folder.request.contexts(n)[0].task
                size = _SizeProofs(folder, observer, proofs.floor_of(task, incumbent, gap), impossible=impossible)
                reusable_proofs = _reusable_proofs(source_run, task)
                stored_proofs = proofs.proofs_of(folder, n)
                size.complete = {key: proof for key, proof in stored_proofs.items() if proof.complete}
                unfinished = proofs.unfinished_proofs(folder, n)
                for row in rows:
                    wanted = _target_proof(task, row, best, gap, problem, centre)
                    stored = (held.get(row.key) for held in (stored_proofs, unfinished))
                    sufficient = (p for p in stored if p and _is_sufficient(p, wanted, size.floor))
                    proof, other = next(sufficient, None), reusable_proofs.get(row.key)
                    if proof is not None:
                        if proof.open_at is not None and size.can_lower(proof):
                            proof = _lower(proof, size.floor)
                    elif other is not None and _shows(other, size.floor, problem) and size.gains(other):
                        reached: Aim = "excluded" if other.level >= proofs.floor_of(task, incumbent) else "within"
                        proof = other.model_copy(update={"aim": reached, "gap": gap})
                        size.unwritten.add(row.key)
                    else:
                        proof = wanted
                    size.proofs[row.key] = proof
                searched_cuts = dict[str, float]()
                has_mass = task.end_effector.rod_mass == "included" and task.search.maximize is None
                if has_mass and any(p.due_chunks() for p in size.proofs.values()):
                    _tell_reach(folder, task, incumbent, solve, engine, observer)
                while searched_cuts != (cuts := {key: proof.cut for key, proof in size.proofs.items()}):
                    searched_cuts = cuts  # trees whose cut is lowered during the search are searched again
                    chunks = sum(len(proof.due_chunks()) for proof in size.proofs.values() if proof.open_at is None)
                    if chunks:
                        started_at = time.monotonic()
                        prepare(task)
                        until += time.monotonic() - started_at
                    observer.phase(Phase("proving", n, chunks, seconds=EXPECTED.chunk_s))
                    search = partial(_search, prove_chunk)
                    results = engine.run(search, size.jobs(), deadline=lambda _: PROOF_LIMITS.chunk_s, until=until)
                    try:
                        for job, result in results:
                            size.add_result(*job, result)
                            observer.settled(incumbent)
                    finally:
                        size.write()
                open_trees[n] = size.open_trees
        except (KeyboardInterrupt, WorkersLost) as stop:
            write_candidates(folder)
            folder.write()
            stop.add_note(KEPT)
            raise
        write_candidates(folder)
        folder.write()
        report(folder)
        folder.ledger.require()
        answer = answer_of(folder)
        answered = (replace(size, proof_open=open_trees.get(size.modules, ())) for size in answer.sizes)
        return replace(answer, sizes=tuple(answered))


def _target_proof(
    task: ResolvedTask,
    row: Row,
    best: float,
    gap: float,
    problem: Problem,
    centre: Callable[[ResolvedTask, Topology], int],
) -> Proof:
    """Return the proof of a tree that is asked for, without chunks."""
    aim, cut = proofs.target(row, best, gap) if task.search.maximize is None else ("within", 0.0)
    if task.search.maximize is not None:
        task = provable_at(task, best * (1 + gap))
        cut = most_effort(task)
    root = centre(task, Topology.from_key(row.key))
    scope = {"gap": gap, "problem": problem, "aim": aim, "cut": cut}
    return Proof(task=task, topology_key=row.key, root_module=root, **scope)


def _search(prove_chunk: ProveChunk, job: tuple[Proof, int]) -> Chunk:
    proof, number = job
    return prove_chunk(proof.task, proof.topology, number, proof.cut, proof.problem)


def _tell_reach(
    folder: RunFolder,
    task: ResolvedTask,
    best: Row,
    solve: Callable[[Job], Design | Infeasible],
    engine: Engine,
    observer: Observer,
) -> None:
    """Tell which gap a proof can reach: it also covers the best design without the mass of its rod."""
    design, _ = folder.result_of(best)
    if design is None:
        return
    massless = task.with_fields("end_effector", rod_mass="ignored")
    job = Job(massless, design.topology, range(best.starts), folder.request.seed, (design,))
    lighter = engine.run_one(solve, job, deadline=job.deadline)
    if isinstance(lighter, Design) and lighter.objective < design.objective:
        gap, mass = 100 * (1 - lighter.objective / design.objective), upper_text(1e3 * task.heaviest_rod, 3)
        observer.note(
            f"{task.n} modules: no gap under {lower_text(gap, 3)} % is within reach: a proof covers rods of any "
            f"mass up to {mass} g, and without that of its own {best.key} needs so much less effort"
        )


def refuse_unprovable(request: Request, name: str) -> None:
    """Refuse a task that cannot be proven, before it is searched.

    Raises:
        BadInput: the task has goals, a lattice, types of module, too many modules or other rotors; `name`: the
            faulty input.
    """
    _refuse_goals(request, name)
    if request.task.search.lattice is not None:
        raise BadInput(name, [Fault("search.lattice", "must be left out: branch and bound takes trees")])
    if types := request.task.module_types:
        rule = f"must be left out: branch and bound takes modules of one kind, but got {len(types)}"
        raise BadInput(name, [Fault("module_types", rule)])
    if not request.task.module.rotor_table.is_flat_quadrotor:
        rule = "must be four along the module's axis, at most arm_length from its centre, for branch and bound"
        raise BadInput(name, [Fault("module.rotors", f"{rule}; the lower bound holds for any")])
    if (n := request.task.sizes[-1]) > PROOF_LIMITS.modules:
        raise BadInput(name, [Fault("modules", f"must be at most {PROOF_LIMITS.modules} for a proof, but got {n}")])


def _refuse_goals(request: Request, name: str) -> None:
    if request.task.goals.names:
        raise BadInput(name, "has goals: a proof needs a single objective; run the task without goals")


def _is_sufficient(proof: Proof, wanted: Proof, floor: float) -> bool:
    """True if a stored proof shows at least what is requested, is a part of that, or all that this gap led to."""
    if proof.complete:
        return _shows(proof, floor if proof.gap == wanted.gap else wanted.level, wanted.problem)
    return proof.level in (wanted.level, floor) and proof.problem == wanted.problem


def _shows(proof: Proof, level: float, problem: Problem) -> bool:
    """True if a complete proof shows a level for the designs of a problem."""
    return proof.level >= level and proof.problem in ("task", problem)


def _reusable_proofs(source_run: Path | None, task: ResolvedTask) -> dict[str, Proof]:
    """Return the proofs of another run that hold for a task."""
    if source_run is None:
        return {}
    with RunFolder.load(source_run) as folder:
        held = proofs.proofs_for(folder, task)
    if not held:
        text = f"has no complete proof that holds for {task.name}, n = {task.n}: only name and exposure may differ"
        raise BadInput(str(source_run), text)
    return held


def _lower(proof: Proof, floor: float) -> Proof:
    return proof.without_chunks.model_copy(update={"aim": "within", "cut": floor})


def _claim(proof: Proof, floor: float) -> str:
    """Return what a complete proof shows, in words."""
    if proof.task.search.maximize is not None:
        return f"proven, {objective_of(proof.task).claim(proof.bound)}"
    if proof.aim == "excluded":
        return "proven, cannot beat the best"
    reference = "the best" if proof.cut == floor else "its own best"
    return f"proven, cannot beat {reference} by more than {gap_percent(proof.gap)}"


def _cause(chunk: Chunk) -> str:
    if chunk.outcome == "many":
        return f"chunk {chunk.number} needs more than {chunk.boxes:,} boxes"
    return f"chunk {chunk.number} cannot exclude a better design with the smallest boxes"


_CheckJob = tuple[Proof, Chunk]
CheckChunk = Callable[[ResolvedTask, Topology, int, float, Chunk, Problem], CheckedChunk]
"""Pure function that checks that no design in one chunk of a tree costs less than a cut [rad^4/s^4]."""


@dataclass
class CheckedTree:
    """Result of checking one tree."""

    key: str
    modules: int
    bound: float | None = None
    """Effort that every design needs [rad^4/s^4], or value that none holds, if the tree is checked and nothing in
    the run is refused."""
    problem: Problem = "task"
    """Designs that the bound covers."""
    fault: str | None = None
    """Why the proof is refused."""
    left: str | None = None
    """Why there is nothing to check: `open`, `not examined` or `impossible`."""
    boxes: int = 0
    """Number of checked boxes."""
    halved: int = 0
    """Number of boxes that the check halved further."""
    chunks: int = 0
    """Number of chunks that passed the check."""

    @property
    def verdict(self) -> str:
        """`checked`, `refused`, `open`, `not examined` or `impossible`."""
        if self.fault is not None:
            return "refused"
        return "checked" if self.left is None else self.left


@dataclass
class Checked:
    """Result of checking a run."""

    trees: list[CheckedTree] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    """Result in words for each size with a best design."""
    faults: list[str] = field(default_factory=list)
    """Faults other than those of single trees."""

    objective: Objective = LEAST_EFFORT
    """Objective that the bounds concern."""
    missing: int = 0
    """Number of candidates that the run has not solved yet; 0 if only one tree is checked."""

    @property
    def refused(self) -> bool:
        """True if anything is wrong."""
        return bool(self.faults) or any(tree.fault is not None for tree in self.trees)

    @property
    def settled(self) -> bool:
        """True if every tree has a valid proof or is impossible."""
        has_open = any(tree.left not in (None, "impossible") for tree in self.trees)
        return not (self.refused or self.missing or has_open)


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
    """Check the proofs of a run, and the audit of the best design that they refer to.

    Args:
        path: the run's folder.
        check_chunk: checks a chunk.
        audit: audits a design.
        key: key of the only tree to check; None: all.
        engine: runs the jobs; affects only the time.
        observer: receives the progress.
        prepare: called before the first chunk of a task is checked, if there is any to check.

    Raises:
        BadInput: it is not a run folder, has no audited design or no such tree.
        WorkersLost: the engine has no workers left.
    """
    checked = Checked()
    with RunFolder.load(path) as folder:
        _refuse_goals(folder.request, str(path))
        checked.objective, sizes = objective_of(folder.request.task), proofs.sizes_with_best(folder, key)
        for n, best, _, rows in sizes:
            if not rows:
                continue
            if fault := _best_fault(folder, best, audit, engine):
                checked.faults.append(fault)
            task, space = folder.request.contexts(n)[0].task, folder.request.space(n)
            trees, jobs = dict[str, CheckedTree](), list[_CheckJob]()
            for row in rows:
                trees[row.key], proof = _examine(folder, row, task, space)
                if proof is not None:
                    jobs += [(proof.without_chunks, chunk) for chunk in proof.chunks]
            if jobs:
                prepare(task)
            _replay(jobs, trees, check_chunk, engine, observer)
            checked.trees += trees.values()
        proof_files = {f"{RunFile.PROOFS}/{tree.key}" for tree in checked.trees}  # refused with their trees
        checked.faults += [f"{name} {CHANGED}" for name in folder.changed_files() if name not in proof_files]
        if checked.refused:  # any fault voids all claims
            for examined in checked.trees:
                examined.bound = None
        for n, best, _, rows in sizes:
            count = folder.request.space(n).count()
            if key is None:
                checked.missing += count - len(rows)
            if len(rows) > 1:
                size_trees = [tree for tree in checked.trees if tree.modules == n]
                checked.sentences.append(_sentence(folder, size_trees, best, count, proven=not checked.refused))
    return checked


def _examine(
    folder: RunFolder, row: Row, task: ResolvedTask, space: Candidates
) -> tuple[CheckedTree, Proof | None]:
    """Return the result for a tree before its chunks are checked, and its proof if there are chunks to check."""
    tree, name = CheckedTree(row.key, row.modules), f"{RunFile.PROOFS}/{row.key}"
    proof: Proof | None = None
    try:
        if space.candidate_of(Topology.from_key(row.key)).key != row.key:
            raise ValueError(f"{row.key} is not the representative of its candidate")
        proof = folder.read_file(name, Proof)
    except BadInput as error:
        tree.fault = f"{name}{':' if error.faults[0].path else ''} {error.faults[0]}"
    except ValueError:
        tree.fault = "is no candidate of this run"
    if proof is not None:
        tree.fault = _mismatch(proof, row.key, task)
    if tree.fault is None and (proof is None or not proof.complete):
        state = "not examined" if proof is None else "open"
        tree.left = "impossible" if row.status == "impossible" else state
    if proof is None or tree.fault is not None or tree.left is not None:
        return tree, None
    tree.bound, tree.problem = proof.bound, proof.problem
    return tree, proof


def _replay(
    jobs: list[_CheckJob],
    trees: dict[str, CheckedTree],
    check_chunk: CheckChunk,
    engine: Engine,
    observer: Observer,
) -> None:
    """Check the chunks, add the results to their trees, and report each tree as it finishes."""
    pending = (job for job in jobs if trees[job[0].topology_key].fault is None)
    note_period_s = 10.0  # between two lines about one tree
    noted_at = time.monotonic()
    results = engine.run(partial(_check, check_chunk), pending, deadline=lambda _: PROOF_LIMITS.chunk_s)
    for (proof, chunk), result in results:
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
    proof, chunk = job
    return check_chunk(proof.task, proof.topology, proof.root_module, proof.cut, chunk, proof.problem)


def _best_fault(folder: RunFolder, best: Row, audit: AuditDesign, engine: Engine) -> str | None:
    """Say what is wrong with the best design, to which the proofs refer."""
    try:
        design, _ = folder.result_of(best)
    except BadInput as error:
        return str(error)
    tasks = [context.task for context in folder.request.contexts(best.modules)]  # a job may raise its own margin
    stated = [tasks[best.step]] if best.value is None else [task_at(task, best.value) for task in tasks]
    if (
        design is None
        or (design.topology.key, design.objective, design.value) != (best.key, best.objective, best.value)
        or design.task not in [task.with_rod(design.task.end_effector.counted_rod) for task in stated]
    ):
        return f"{best.key}: its design is of another tree, task or objective"
    verdict = engine.run_one(audit, design, deadline=audit_deadline(best.modules))
    if isinstance(verdict, Failed):
        return f"{best.key}: the audit of the best design failed: {verdict.reason}"
    return None if verdict.verdict == "clear" else f"{best.key}: the audit of the best design is {verdict.verdict}"


def _mismatch(proof: Proof, key: str, task: ResolvedTask) -> str | None:
    """Say why a proof does not belong to this tree and task."""
    if proof.topology_key != key:
        return f"{RunFile.PROOFS}/{key} is the proof of another tree, {proof.topology_key}"
    if not proofs.concerns(proof, task):
        return f"{RunFile.PROOFS}/{key} is about another task"
    numbers = [chunk.number for chunk in proof.chunks]
    if len(set(numbers)) < len(numbers):
        return f"{RunFile.PROOFS}/{key} has a chunk twice"
    return None


def _sentence(folder: RunFolder, trees: list[CheckedTree], best: Row, candidates: int, *, proven: bool) -> str:
    """State the result for one size; `proven`: nothing in the run is refused."""
    checked = [tree for tree in trees if tree.verdict == "checked"]
    counts = {word: sum(tree.verdict == word for tree in trees) for word in ("refused", "open", "not examined")}
    counts["not examined"] += candidates - len(trees)
    unproven = [f"{number} {word}" for word, number in counts.items() if number]
    number = sum(tree.verdict == "impossible" for tree in trees)
    impossible = f", {number} recorded as impossible, which is not checked" if number else ""
    if unproven or not proven:
        return ", ".join([f"{len(checked)} of {candidates} trees checked", *unproven]) + impossible
    bounds = [tree.bound for tree in checked if tree.bound is not None]
    _, claim, scope = proofs.claim_of(folder, best, bounds, [tree.problem for tree in checked])
    than = f" than {best.key}" if folder.request.task.search.maximize is None else ""
    return f"checked: {claim}{than} ({len(checked)} of {candidates} trees{impossible}); {scope}"
