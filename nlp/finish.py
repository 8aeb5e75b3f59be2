"""From the point that Ipopt reached to one that a file can hold: angles wrapped, inputs exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlp.evaluate import asked_wrenches, wrench_matrix
from nlp.geometry import root_angles, root_rotation
from nlp.point import Point

PASSES = 3
"""Most corrections of the inputs; one leaves rounding errors only, unless an input meets its bound."""


def finish(point: Point) -> Point:
    """Return the point with its root angles in range and its inputs on the wrench balance.

    Every load case's inputs are moved by the least-norm correction over the rotors that are not at a bound, then
    brought inside their bounds: the balance that Ipopt meets to its tolerance is then met to rounding.
    """
    u_max = point.task.max_input
    A, b = wrench_matrix(point), asked_wrenches(point)
    u = np.clip(point.u.reshape(len(b), -1), 0.0, u_max)
    unfinished = np.arange(len(b))
    for _ in range(PASSES):
        before = u[unfinished]
        free = (before > 0.0) & (before < u_max)
        inverses = np.linalg.pinv(A * free[:, None], rcond=1e-6)
        correction = np.einsum("krw,kw->kr", inverses, b[unfinished] - before @ A.T)
        corrected = np.where(free, before + correction, before)
        u[unfinished] = np.clip(corrected, 0.0, u_max)
        met_bound = np.any(free & ((corrected <= 0.0) | (corrected >= u_max)), axis=1)
        unfinished = unfinished[met_bound]
        if not len(unfinished):
            break
    root = root_angles(root_rotation(point.root)) if point.task.search.root == "free" else point.root
    return replace(point, root=root, u=u.reshape(point.u.shape))
