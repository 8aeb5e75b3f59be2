"""Which rotors run in each load case: all of them, but for those that must do with one rotor dead."""

from __future__ import annotations

import numpy as np

from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array


def running_rotors(task: ResolvedTask) -> Array:
    """Return 1 for each rotor that runs in a load case and 0 for one that is dead, shape (K, 4n).

    Limits of inputs times it are those of each rotor: a dead one is exempt from the least input.
    """
    alive = np.ones((len(task.load_cases), 4 * task.n))
    for k, dead in enumerate(task.dead_rotors):
        if dead is not None:
            alive[k, dead] = 0.0
    return alive
