"""What proofs by branch and bound show for each candidate of a run, and for a whole size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from topo_search.limits import quantity
from topo_search.model import Audit, BadInput, Proof, ResolvedTask, objective_of
from topo_search.model.exposure import half_spaces
from topo_search.model.maximized import provable_at
from topo_search.model.proof import Aim, Problem, most_effort
from topo_search.model.proven import gap_percent, upper_text
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row

if TYPE_CHECKING:
    from topo_search.study.answer import SizeAnswer


class ProofState(NamedTuple):
    """What is proven about one tree."""

    proven_bound: float | None
    """No design of the tree costs less [rad^4/s^4], or holds as much of the maximised quantity."""
    proven_gap: float | None
    """Largest share by which it can improve on its best design: 1 - bound / objective, or bound / value - 1."""
    proven_problem: Problem | None
    """Designs that the bound covers."""
    proof: str | None
    """`excluded`: cannot beat the run's best; `within`: not below a cut under the best; `open`; `impossible`."""


def proof_state(row: Row, proof: Proof | None, best: Row | None) -> ProofState:
    """Return what is proven of a tree.

    Args:
        row: the tree's row.
        proof: the tree's proof, if there is one.
        best: the best design of its size with a clear audit, if there is one.
    """
    if row.status == "impossible":
        return ProofState(None, None, None, "impossible")
    if proof is None:
        return ProofState(None, None, None, None)
    bound, word = row.lower_bound if row.value_bound is None else row.value_bound, "open"
    if proof.complete:
        bound = proof.bound
        word = "excluded" if best is not None and proof.level >= floor_of(proof.task, best) else "within"
    gap = None if bound is None or row.objective is None else objective_of(proof.task).gap(row, bound)
    return ProofState(bound, None if gap is None else max(0.0, gap), proof.problem, word)


def floor_of(task: ResolvedTask, best: Row, gap: float = 0.0) -> float:
    """Return the level of a proof that no design is better than the best by more than a gap."""
    number = objective_of(task).number(best) or 0.0
    return number * (1 - gap) if task.search.maximize is None else -number * (1 + gap)


def concerns(proof: Proof, task: ResolvedTask) -> bool:
    """True if a proof is about the effort of a task, or about a value of its maximised quantity."""
    value = proof.task.search.reached
    if task.search.maximize is None:
        return proof.task == task
    return value is not None and proof.task == provable_at(task, value) and proof.cut >= most_effort(proof.task)


def candidates_of(folder: RunFolder, n: int) -> Iterator[tuple[Row, ProofState, Audit | None]]:
    """Yield every candidate of n modules, lowest effort first, with its proof and its audit."""
    proofs, best, contexts = proofs_of(folder, n), folder.ledger.best_clear(n), folder.request.contexts(n)
    for row in folder.ledger.ranking(n):
        state = proof_state(row, proofs.get(row.key), best)
        yield row, state, folder.ledger.audit(contexts[row.step], row.key) if row.audit else None


def proofs_of(folder: RunFolder, n: int) -> dict[str, Proof]:
    """Return the proofs of candidates of n modules for exactly the task of a run, by key.

    Raises:
        BadInput: one of them is damaged, or contradicts a design.
    """
    task = folder.request.contexts(n)[0].task
    return {proof.topology_key: proof for proof in _sound_proofs(folder, n) if concerns(proof, task)}


def unfinished_proofs(folder: RunFolder, n: int) -> dict[str, Proof]:
    """Return the incomplete proofs of candidates of n modules that also have a complete one, by key.

    Raises:
        BadInput: one of them is damaged.
    """
    task = folder.request.contexts(n)[0].task
    proofs = folder.read_files(RunFile.UNFINISHED, Proof)
    return {key: proof for key, proof in proofs.items() if concerns(proof, task)}


def proofs_for(folder: RunFolder, task: ResolvedTask) -> dict[str, Proof]:
    """Return the complete proofs that also hold for a task of another run, by key, with that task.

    Raises:
        BadInput: one of them is damaged, or contradicts a design.
    """
    proofs = (proof for proof in _sound_proofs(folder, task.n) if proof.complete)
    valid = dict[str, Proof]()
    for proof in proofs:
        value = proof.task.search.reached
        stated = provable_at(task, value) if value is not None and task.search.maximize else task
        if proofs_hold_for(proof.task, stated):
            valid[proof.topology_key] = proof.model_copy(update={"task": stated})
    return valid


def _sound_proofs(folder: RunFolder, n: int) -> Iterator[Proof]:
    """Yield all proofs of a folder; refuse one of n modules that excludes a design with a clear audit."""
    if not (proofs := folder.read_files(RunFile.PROOFS, Proof)):
        return
    clear = {row.key: row for row in folder.ledger.ranking(n) if row.clear}
    for name, proof in proofs.items():
        design, objective = clear.get(proof.topology_key), objective_of(proof.task)
        is_concerned = proof.complete and proof.task.n == n
        if is_concerned and design is not None and floor_of(proof.task, design) < proof.level:
            rule = (
                f"proves {objective.claim(proof.bound)} of a tree with an audited design of "
                f"{objective.number(design)!r}: remove it, and run `topo-search prove` again"
            )
            raise BadInput(str(folder.path / RunFile.PROOFS / name), rule)
        yield proof


def target(row: Row, best: float, gap: float) -> tuple[Aim, float]:
    """Return the aim of a tree's proof about effort and its cut.

    Returns:
        `excluded` and the effort of the run's best; or `within` and the effort `gap` under the tree's own best, if
        that is lower.
    """
    if row.objective is not None and row.objective * (1 - gap) < best:
        return "within", row.objective * (1 - gap)
    return "excluded", best


def proofs_hold_for(task: ResolvedTask, other: ResolvedTask) -> bool:
    """True if proofs for `task` hold for `other`: only the name and exposure beyond `task`'s half-spaces differ."""
    is_same = task.model_copy(update={"name": other.name, "exposure": other.exposure}) == other
    return is_same and set(half_spaces(task.exposure)) <= set(half_spaces(other.exposure))


def bounded_requirements(task: ResolvedTask, about: Problem) -> list[str]:
    """Return the requirements beyond load cases and airflow that the bound takes into account."""
    flight, words = task.flight, list[str]()
    if any(case.corners for case in task.load_cases):
        words.append("sets of wrenches")
    if task.search.peak_input == 1:
        balls = "corners around the balls" if about == "solver" else "points of the balls"
        words += [f"reserves ({balls})"] * (flight.force_reserve > 0 or flight.torque_reserve > 0)
        words += ["tilts"] * (flight.tilt_deg > 0 and (about == "task" or flight.allocator == "optimal"))
        words += ["errors of the centre of mass"] * (flight.com_error > 0)
        if flight.rotor_out != "none":
            which = "hover" if flight.rotor_out == "hover" else "hover and load cases that carry the weight"
            words.append(f"{which} with any one rotor dead")
    if rod_mass := task.lightest.heaviest_rod:
        words.append(f"rods of any mass up to {upper_text(rod_mass, 3)} kg")
    words += ["minimum inputs"] * (task.min_input > 0)
    if half_spaces(task.exposure) and task.end_effector.fixed_position is None:
        words.append("half-spaces that hold the airflow")
    return words


def add_proofs(folder: RunFolder, size: SizeAnswer) -> SizeAnswer:
    """Return the answer of a size with what its proofs show together, if there is any."""
    n, best, proofs = size.modules, size.best, proofs_of(folder, size.modules)
    if best is None or best.objective is None or not proofs:
        return size
    states = {row.key: proof_state(row, proofs.get(row.key), best) for row in folder.ledger.ranking(n)}
    counts = Counter(state.proof or "not examined" for state in states.values())
    words = {
        "excluded": "cannot beat the best",
        "within": "proven to within a gap",
        "impossible": "impossible",
        "open": "open",
        "not examined": "not examined",
    }
    verdicts = ", ".join(f"{counts[name]} {text}" for name, text in words.items() if counts[name])
    number, unsolved = quantity(size.candidates, "candidate"), size.candidates - len(states)
    if unsolved:
        verdicts += f", {unsolved} not solved by `run`"
    unproven = [key for key, state in states.items() if state.proof in ("open", None)]
    unfinished = unfinished_proofs(folder, n)
    latest, incomplete = {**proofs, **unfinished}, (*unproven, *unfinished)
    # with a chunk that cannot be closed even at the lowest level that its gap allows
    open_proofs = {key: latest[key] for key in incomplete if key in latest and latest[key].open_at is not None}
    stuck = [key for key, proof in open_proofs.items() if proof.level <= floor_of(proof.task, best, proof.gap)]
    resumable = tuple(key for key in incomplete if key not in stuck)
    if unproven or unsolved:
        sentence = f"branch and bound, {number}: {verdicts}; nothing new is proven for the size while some are open"
        if stuck:
            shown = ", ".join(stuck[:3]) + ", ..." * (len(stuck) > 3)
            sentence += (
                f"; the same command cannot close {shown}: some boxes may contain a better design, or there are "
                "too many; try a larger --gap or --problem solver"
            )
        return replace(size, proven=sentence, proof_resumable=resumable)
    bounds = [state.proven_bound for state in states.values() if state.proven_bound is not None]
    problems = [proof.problem for key, proof in proofs.items() if key in states]
    gap, claim, scope = claim_of(folder, best, bounds, problems)
    return replace(
        size,
        statement=proven_statement(size.candidates, gap, folder.request.contexts(n)[0].task.attitude),
        proven=f"proven by branch and bound: {claim} ({number}: {verdicts}); {scope}",
        proven_gap=gap if size.covers_size else None,
        candidates_gap=gap,
        proof_resumable=resumable,
    )


def proven_statement(candidates: int, gap: float, attitude: str) -> str:
    """State that the best design is proven to be the best, up to a gap."""
    number = "the only candidate" if candidates == 1 else f"all {candidates} candidates"
    return f"the best of {number}, proven{attitude}" + (f" to within {gap_percent(gap)}" if gap > 0 else "")


def claim_of(
    folder: RunFolder, best: Row, bounds: Sequence[float], problems: Sequence[Problem]
) -> tuple[float, str, str]:
    """Return what the bounds of all trees prove for a size: the gap, the claim in words, and its scope in words.

    Args:
        folder: the run's folder.
        best: the best design of the size.
        bounds: bounds of the trees with a complete proof [rad^4/s^4, or unit of the maximised quantity].
        problems: designs that each of the proofs covers; the claim covers those that all of them do.
    """
    task, n = folder.request.contexts(best.modules)[0].task, best.modules
    objective = objective_of(task)
    number = objective.number(best) or 0.0
    bound = min(bounds, default=number) if task.search.maximize is None else max(bounds, default=number)
    gap = max(0.0, objective.gap(best, bound) or 0.0)
    subject = f"no {n}-module topology" if folder.request.covers(n) else f"none of the {n}-module candidates"
    about: Problem = "solver" if "solver" in problems else "task"
    claim = objective.bound_words(replace(best, gap=gap, value_bound=bound))
    stated = task if task.search.maximize is None else provable_at(task, bound)
    return gap, f"{subject} {claim}", problem(stated, about)


def sizes_with_best(folder: RunFolder, key: str | None) -> list[tuple[int, Row, float, list[Row]]]:
    """Return each size with a clear design: n, its best design, its number, and all rows, or only that of `key`.

    The number is its effort, or its value of the maximised quantity.

    Raises:
        BadInput: no row has the key, or no size has such a design.
    """
    ranking, sizes_asked = folder.ledger.ranking, folder.request.task.sizes
    rows = {n: [row for row in ranking(n) if key in (None, row.key)] for n in sizes_asked}
    if key is not None and not any(rows.values()):
        raise BadInput(str(folder.path), f"has no candidate {key}")
    best = ((n, folder.ledger.best_clear(n)) for n in rows)
    number = objective_of(folder.request.task).number
    sizes = [(n, row, number(row) or 0.0, rows[n]) for n, row in best if row is not None and number(row)]
    if not sizes:
        raise BadInput(str(folder.path), "has no audited design to prove against")
    return sizes


def problem(task: ResolvedTask, about: Problem) -> str:
    """State the scope of a proof: the designs that it covers."""
    margin = f" and {upper_text(task.search.least_margin)} m" if about == "solver" else ""
    if task.search.interference == "separation":
        distances = f"centres of modules may be {upper_text(task.separation)} m{margin} apart"
    else:
        what = "airflow envelopes"
        if task.search.interference == "parts":
            what = "rotors, hubs and arms and other modules' airflow envelopes"
        distances = f"{what} may be{margin.removeprefix(' and')} apart" if margin else f"{what} may touch"
        clearance = task.centre_distance if about == "solver" else task.body_clearance
        if clearance is not None:
            distances += f" and centres of modules not bolted together be {upper_text(clearance)} m{margin} apart"
    distances = f"the solver's own distances, {distances}" if about == "solver" else distances
    if requirements := bounded_requirements(task, about):
        distances += f"; with {', '.join(requirements)}"
    # a proof holds for the trees and the orientations that the task allows
    connectors = "aligned connectors, " if task.search.connectors == "aligned" else ""
    given = "the paper's orientations" if task.search.root == "paper" else "the given orientation"
    root = f"{given} of the root" if task.search.root_ranges else "any orientation"
    attitude = f", the same for all wrenches ({task.attitude.strip()})" if task.attitude else ""
    effect = "raise the control effort" if task.search.maximize is None else "lower what a platform holds"
    is_set = task.search.hinge_set_deg is not None
    hinges = "hinge angles of the task's set" if is_set else "hinge angles within 90 deg either way"
    return (
        f"scope: {connectors}{root}{attitude}, {hinges}, every wrench and input within the audit's "
        f"tolerance; {distances}; all other requirements are left out, and can only {effect}"
    )
