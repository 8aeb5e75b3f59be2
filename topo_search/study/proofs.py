"""Proofs by branch and bound for a run's candidates, and for all of them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from topo_search.limits import quantity
from topo_search.model import Audit, BadInput, Proof, ResolvedTask
from topo_search.model.exposure import half_spaces
from topo_search.model.proof import Problem
from topo_search.model.proven import improvement, upper_text
from topo_search.study.ledger import AUDITED, COLUMNS, Row, figures_of

if TYPE_CHECKING:
    from topo_search.study.folder import RunFolder

EXCLUDED, WITHIN, OPEN, IMPOSSIBLE = "excluded", "within", "open", "impossible"


class ProofState(NamedTuple):
    """Proven facts about one tree."""

    proven_bound: float | None
    """No design of the tree costs less [rad^4/s^4]."""
    proven_gap: float | None
    """1 - proven_bound / objective: how much less than its best one it can cost."""
    proven_problem: Problem | None
    """Designs that the bound is about."""
    proof: str | None
    """`excluded`: no less than the run's best; `within`: no less than a cut under it; `open`; `impossible`."""


def proof_state(row: Row, proof: Proof | None, best: float | None) -> ProofState:
    """Return what is proven of a tree.

    Args:
        row: of the tree.
        proof: of the tree, if there is any.
        best: the least effort of designs of its size whose audit is clear.
    """
    if row.status == IMPOSSIBLE:
        return ProofState(None, None, None, IMPOSSIBLE)
    if proof is None:
        return ProofState(None, None, None, None)
    bound = proof.cut if proof.complete else row.lower_bound
    word = OPEN
    if proof.complete:
        word = EXCLUDED if best is not None and proof.cut >= best else WITHIN
    gap = None
    if bound is not None and row.objective:
        gap = max(0.0, 1 - bound / row.objective)
    return ProofState(bound, gap, proof.problem, word)


def cells(row: Row, state: ProofState, audit: Audit | None) -> list[object]:
    """Return a candidate's row of `candidates.csv`."""
    beside = {**state._asdict(), **(dict.fromkeys(AUDITED) if audit is None else figures_of(audit))}
    return [beside[name] if name in beside else getattr(row, name) for name in COLUMNS]


def target(row: Row, best: float, gap: float) -> tuple[str, float]:
    """Return what is to be proven of a tree: that it cannot beat the best, or if it comes near, by how little.

    Returns:
        `excluded` and the best's effort; or `within` and the effort that is `gap` under the tree's own best.
    """
    if row.objective is not None and row.objective * (1 - gap) < best:
        return WITHIN, row.objective * (1 - gap)
    return EXCLUDED, best


def bounded_alike(task: ResolvedTask, other: ResolvedTask) -> bool:
    """True if a proof of one task is one of the other: the same but for name and exposure that no bound knows."""
    alike = task.model_copy(update={"name": other.name, "exposure": other.exposure}) == other
    return alike and set(half_spaces(task.exposure)) <= set(half_spaces(other.exposure))


def knows(task: ResolvedTask, about: Problem) -> list[str]:
    """Return which requirements beyond load cases and airflow a bound takes in."""
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
    words += ["least inputs"] * (task.min_input > 0)
    if half_spaces(task.exposure) and task.end_effector.fixed_position is None:
        words.append("half-spaces that hold the airflow")
    return words


class ProofSummary(NamedTuple):
    """Summary of the proofs of one size."""

    sentence: str | None = None
    """None unless a proof was asked for."""
    gap: float | None = None
    """Largest share by which a design of this size can cost less than the best; None while trees are open."""
    resumable: tuple[str, ...] = ()
    """The trees that are open and of which the same command could prove more."""


def summarize(folder: RunFolder, n: int, best: Row | None) -> ProofSummary:
    """Say what the proofs of one size come to together; `best`: the best design whose audit is clear."""
    proofs = folder.proofs(n)
    if best is None or best.objective is None or not proofs:
        return ProofSummary()
    candidates = folder.request.space(n).count()
    states = {row.key: proof_state(row, proofs.get(row.key), best.objective) for row in folder.ledger.ranking(n)}
    counts = Counter(one.proof or "not examined" for one in states.values())
    words = {
        EXCLUDED: "cannot beat the best",
        WITHIN: "proven to within the gap asked for",
        IMPOSSIBLE: "impossible",
        OPEN: "open",
        "not examined": "not examined",
    }
    verdicts = ", ".join(f"{counts[name]} {text}" for name, text in words.items() if counts[name])
    number, unsolved = quantity(candidates, "candidate"), candidates - len(states)
    if unsolved:
        verdicts += f", {unsolved} not solved by `run`"
    due = [key for key, state in states.items() if state.proof in (OPEN, None)]
    if due or unsolved:
        sentence = f"branch and bound, {number}: {verdicts}; nothing new is proven while some are open"
        stuck = [key for key in due if key in proofs and is_stuck(proofs[key], best.objective)]
        if stuck:
            shown = ", ".join(stuck[:3]) + ", ..." * (len(stuck) > 3)
            sentence += (
                f"; the same command cannot close {shown}, of which some boxes may hold a better design or are too "
                "many: try a larger --gap or --problem solver"
            )
        return ProofSummary(sentence, None, tuple(key for key in due if key not in stuck))
    bounds = [one.proven_bound for one in states.values() if one.proven_bound is not None]
    gap, claim, scope = claim_of(
        folder, best, bounds, [proof.problem for key, proof in proofs.items() if key in states]
    )
    return ProofSummary(f"proven by branch and bound: {claim} ({number}: {verdicts}); {scope}", gap)


def claim_of(
    folder: RunFolder, best: Row, bounds: Sequence[float], problems: Sequence[Problem]
) -> tuple[float, str, str]:
    """Return what the bounds of all trees of a size prove: its gap, in words, and which designs it is about.

    Args:
        folder: of the run.
        best: the best design of the size.
        bounds: of trees with a complete proof [rad^4/s^4].
        problems: designs that the proofs are about: together, those that all of them are about.
    """
    effort, n = best.objective or 0.0, best.modules
    gap = max(0.0, 1 - min(bounds, default=effort) / effort)
    subject = f"no {n}-module topology" if folder.request.covers(n) else f"none of the {n}-module candidates"
    about: Problem = "solver" if "solver" in problems else "task"
    return gap, f"{subject} is {improvement(gap)}", problem(folder.request.contexts(n)[0].task, about)


def sizes_with_best(folder: RunFolder, key: str | None, *, none: str) -> list[tuple[int, Row, float, list[Row]]]:
    """Return every size with a clear design: it, its effort, and all rows, or that of a key.

    Raises:
        BadInput: no row has the key, or no size has such a design, which `none` says.
    """
    rows = {
        n: [row for row in folder.ledger.ranking(n) if key in (None, row.key)] for n in folder.request.task.sizes
    }
    if key is not None and not any(rows.values()):
        raise BadInput(str(folder.path), f"has no candidate {key}")
    best = ((n, folder.ledger.best_clear(n)) for n in rows)
    sizes = [(n, row, row.objective, rows[n]) for n, row in best if row is not None and row.objective]
    if not sizes:
        raise BadInput(str(folder.path), none)
    return sizes


def is_stuck(proof: Proof, best: float) -> bool:
    """True if a proof has a chunk that cannot be closed, at the lowest cut that its gap allows."""
    return proof.open_at is not None and proof.cut <= best * (1 - proof.gap)


def problem(task: ResolvedTask, about: Problem) -> str:
    """Say precisely which designs a proof is about."""
    margin = f" and {upper_text(task.search.margin)} m" if about == "solver" else ""
    if task.search.interference == "separation":
        kept = f"centres of modules may be {upper_text(task.separation)} m{margin} apart"
    else:
        what = "airflow envelopes"
        if task.search.interference == "parts":
            what = "rotors, hubs and arms and other modules' airflow envelopes"
        kept = f"{what} may be{margin.removeprefix(' and')} apart" if margin else f"{what} may touch"
        apart = task.centre_distance if about == "solver" else task.body_clearance
        if apart is not None:
            kept += f" and centres of modules not bolted together be {upper_text(apart)} m{margin} apart"
    kept = f"the solver's own distances, {kept}" if about == "solver" else kept
    if known := knows(task, about):
        kept += f"; with {', '.join(known)}"
    # a proof holds for the trees and the orientations that the task allows
    connectors = "aligned connectors, " if task.search.connectors == "aligned" else ""
    root = "any orientation" if task.search.root == "free" else "the paper's orientations of the root"
    of_set = task.search.hinge_set_deg is not None
    hinges = "hinge angles of the task's set" if of_set else "hinge angles within 90 deg either way"
    return (
        f"scope: {connectors}{root}, {hinges}, every wrench and input within the "
        f"audit's tolerance; {kept}; all other requirements are left out, and can only raise the control effort"
    )
