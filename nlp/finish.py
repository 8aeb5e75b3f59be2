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
    K, width = len(b), A.shape[1]
    u = np.clip(point.u.reshape(K, width), 0.0, u_max)
    for k in range(K):
        for _ in range(PASSES):
            free = (u[k] > 0.0) & (u[k] < u_max)
            correction = np.linalg.lstsq(A[:, free], b[k] - A @ u[k], rcond=1e-6)[0]
            corrected = u[k, free] + correction
            u[k, free] = np.clip(corrected, 0.0, u_max)
            if np.all((corrected > 0.0) & (corrected < u_max)):
                break
    root = root_angles(root_rotation(point.root)) if point.task.search.root == "free" else point.root
    return replace(point, root=root, u=u.reshape(point.u.shape))
