"""What proofs by branch and bound say of a run's candidates, and of all of them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from topo_search.model import Proof, ResolvedTask
from topo_search.model.proven import gap_percent
from topo_search.study.row import COLUMNS, Row

EXCLUDED, WITHIN, OPEN, IMPOSSIBLE = "excluded", "within", "open", "impossible"


class Standing(NamedTuple):
    """What is proven of one tree."""

    proven_bound: float | None
    """No design of the tree costs less [rad^4/s^4]."""
    proven_gap: float | None
    """1 - proven_bound / objective: how much less than its best one it can cost."""
    proof: str | None
    """`excluded`: no less than the run's best; `within`: no less than a cut under it; `open`; `impossible`."""


def standing(row: Row, proof: Proof | None, best: float | None) -> Standing:
    """Return what is proven of a tree.

    Args:
        row: of the tree.
        proof: of the tree, if there is any.
        best: the least effort of designs of its size whose audit is clear.
    """
    if row.status == IMPOSSIBLE:
        return Standing(None, None, IMPOSSIBLE)
    if proof is None:
        return Standing(None, None, None)
    bound = proof.cut if proof.complete else row.lower_bound
    word = OPEN
    if proof.complete:
        word = EXCLUDED if best is not None and proof.cut >= best else WITHIN
    gap = None
    if bound is not None and row.objective:
        gap = max(0.0, 1 - bound / row.objective)
    return Standing(bound, gap, word)


def cells(row: Row, stands: Standing) -> list[object]:
    """Return a candidate's row of `candidates.csv`."""
    proven = stands._asdict()
    return [proven[name] if name in proven else getattr(row, name) for name in COLUMNS]


def target(row: Row, best: float, gap: float) -> tuple[str, float]:
    """Return what is to be proven of a tree: that it cannot beat the best, or if it comes near, by how little.

    Returns:
        `excluded` and the best's effort; or `within` and the effort that is `gap` under the tree's own best.
    """
    if row.objective is not None and row.objective * (1 - gap) < best:
        return WITHIN, row.objective * (1 - gap)
    return EXCLUDED, best


def proven_sentence(
    rows: Sequence[Row], proofs: Mapping[str, Proof], best: Row | None, task: ResolvedTask, candidates: int
) -> str | None:
    """Say what the proofs of one size come to together; None while nobody asked for any.

    Args:
        rows: of all candidates that are settled.
        proofs: by key.
        best: the best design whose audit is clear.
        task: the task.
        candidates: how many there are.
    """
    if best is None or best.objective is None or not proofs:
        return None
    stands = [standing(row, proofs.get(row.key), best.objective) for row in rows]
    counts = Counter(one.proof or "not looked at" for one in stands)
    words = {
        EXCLUDED: "cannot beat the best",
        WITHIN: "proven to within the gap asked for",
        IMPOSSIBLE: "impossible",
        OPEN: "open",
        "not looked at": "not looked at",
    }
    told = ", ".join(f"{counts[name]} {text}" for name, text in words.items() if counts[name])
    left = counts[OPEN] + counts["not looked at"] + candidates - len(rows)
    if left:
        return f"branch and bound, {candidates} candidates: {told}; nothing new is proven while some are open"
    least = min([one.proven_bound for one in stands if one.proven_bound is not None], default=best.objective)
    gap = max(0.0, 1 - least / best.objective)
    limit = f"more than {gap_percent(gap)} " if gap > 0 else ""
    return (
        f"proven by branch and bound: no {task.n}-module topology is {limit}better "
        f"({candidates} candidates: {told}); {problem(task)}"
    )


def problem(task: ResolvedTask) -> str:
    """Say precisely which problem a proof is about."""
    if task.search.interference == "airflow":
        kept = "airflow envelopes may touch"
        if task.body_clearance is not None:
            kept += f" and centres of modules not bolted together be {task.body_clearance:g} m apart"
    else:
        kept = f"centres of modules may be {task.separation:g} m apart"
    root = "any orientation" if task.search.root == "free" else "the paper's orientations of the root"
    return (
        f"that is about {root}, hinges within a right angle either way, every wrench and input within the audit's "
        f"tolerance; {kept}; what else the task asks for can only cost more"
    )
