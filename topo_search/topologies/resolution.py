"""What a symmetry means for one task: what it merges, and whether that is exact, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topo_search.model import ResolvedTask
from topo_search.topologies.symmetry import Group, Symmetry, group_of
from topo_search.topologies.task_symmetry import TOLERANCE, improper_isometry


@dataclass(frozen=True)
class Resolution:
    """A symmetry as it applies to one task."""

    group: Group
    """The turns and mirrors of the root's frame under which trees are one candidate."""
    exact: bool
    """Whether all trees that stand for one candidate have the same optimum."""
    reason: str
    """What is merged and why, for a reader."""


def resolve_symmetry(task: ResolvedTask, symmetry: Symmetry = "task") -> Resolution:
    """Return what a symmetry means for a task. ValueError names an unknown symmetry."""
    connectors, root = task.search.connectors, task.search.root
    isometry = improper_isometry(task)
    group = group_of(symmetry, connectors=connectors, root=root, mirrors=isometry is not None)
    if root == "paper":
        if group == "c1":
            return Resolution(group, True, "with the paper's root no two rooted trees are the same design")
        return Resolution(group, False, "lossy: with the paper's root nothing but the identity is exact")
    if group == "c1":
        return Resolution(group, True, "every tree is a candidate")
    if group in ("c4", "d4"):
        return Resolution(group, False, "lossy: a quarter turn reverses every rotor's spin")
    turns = "half turns" if connectors == "aligned" else "quarter turns with the spin flip"
    if group == "c2":
        if symmetry != "task":
            return Resolution(group, True, f"{turns} are the same design")
        return Resolution(group, True, f"{turns} are the same design; no mirror maps the task onto itself")
    if isometry is None:
        return Resolution(group, False, "lossy: no mirror maps the task onto itself")
    mirror = f"{describe(isometry)} maps the task onto itself"
    return Resolution(group, True, f"{turns} and mirrored trees are the same design: {mirror}")


def describe(O: NDArray[np.float64]) -> str:
    """Return an improper isometry, shape (3, 3), in words."""
    turn = float(np.trace(O)) + 1.0  # twice the cosine of the turn about the normal
    if turn <= -2.0 + TOLERANCE:
        return "the point reflection"
    _, _, rows = np.linalg.svd(O + np.eye(3))
    normal = rows[-1] / rows[-1][np.argmax(np.abs(rows[-1]))]
    text = ", ".join(f"{x:.4g}" for x in np.where(np.abs(normal) > TOLERANCE, normal, 0.0))
    if turn >= 2.0 - TOLERANCE:
        return f"the reflection along [{text}]"
    degrees = np.degrees(np.arccos(turn / 2))
    return f"the reflection along [{text}] with a turn of {degrees:.4g} deg about it"
