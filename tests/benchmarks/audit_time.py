"""Time and memory of an audit on one core.

    PYTHONPATH=tests OMP_NUM_THREADS=1 python tests/benchmarks/audit_time.py [--sizes 5 20 100] [--repeats N]

Uniformly drawn trees with random hinge angles, and a ball, a path and a cone at the end-effector. The first audit
of a size builds tables that later ones share. CPU time is that of this process.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections import Counter

import numpy as np
from verify_cases import HOVER, design

from topo_search.model import Design
from topo_search.topologies import sample
from verify import audit

EXPOSURE = [
    {"kind": "local", "radius": 0.15},
    {"kind": "directional", "radius": 0.15, "segments": [[1.0, 0.0, 0.0]]},
    {"kind": "exterior", "half_angle_deg": 60.0, "axis": [0.0, 0.0, -1.0]},
]


def random_platform(n: int, seed: int) -> Design:
    """Return a platform of n modules, feasible or not."""
    (topology,) = sample(n, 1, seed)
    hinges = np.random.default_rng(seed).uniform(-0.6, 0.6, n - 1)
    task = {"load_cases": [HOVER], "exposure": EXPOSURE}
    return design(topology, task, hinges=tuple(hinges.tolist()), end_effector=(0.0, 0.0, 1.0))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[5, 20, 100])
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    print(f"{'modules':>8}{'clearances':>11}{'processor s':>12}{'wall s':>8}{'peak MB':>9}  statuses")
    for n in arguments.sizes:
        for seed in range(arguments.repeats):
            platform = random_platform(n, seed)
            processor, wall = time.process_time(), time.perf_counter()
            result = audit(platform)
            processor, wall = time.process_time() - processor, time.perf_counter() - wall
            # peak of the process so far, in kilobytes, on macOS in bytes
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
            counts = ", ".join(
                f"{k} {status}" for status, k in Counter(str(p.status) for p in result.pairs).items()
            )
            print(f"{n:>8}{len(result.pairs):>11}{processor:>12.3f}{wall:>8.3f}{peak:>9.0f}  {counts}", flush=True)


if __name__ == "__main__":
    main()
