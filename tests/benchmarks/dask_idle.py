"""CPU time of Dask's own processes while workers solve, with default and with documented settings.

    PYTHONPATH=tests python tests/benchmarks/dask_idle.py [--seconds S]

Two Dask workers run jobs that only wait, so all CPU time of their processes and of the scheduler is Dask's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import psutil
from dask_cluster import Cluster
from engine_jobs import LONG, pause
from workers import cpu

from topo_search.engine import DaskWorkers

PROFILE, TICKS, MEMORY = (
    f"DASK_DISTRIBUTED__{name}"
    for name in ("WORKER__PROFILE__ENABLED", "ADMIN__TICK__INTERVAL", "WORKER__MEMORY__MONITOR_INTERVAL")
)
DEFAULTS = {PROFILE: "True", TICKS: "20ms", MEMORY: "100ms"}
"""Dask's defaults for the settings of the documented job script."""
SETTINGS = {
    "defaults": DEFAULTS,
    "without profile": {**DEFAULTS, PROFILE: "False"},
    "with slow ticks": {**DEFAULTS, TICKS: "1s"},
    "checking memory less often": {**DEFAULTS, MEMORY: "1s"},
    "all three, as documented": {},
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    print(f"{'CPU in shares of one core':30}{'scheduler':>12}{'a worker':>12}")
    for name, settings in SETTINGS.items():
        with tempfile.TemporaryDirectory() as folder, Cluster(Path(folder), **settings) as cluster:
            worker = cluster.add_worker("--nworkers", "2")
            with DaskWorkers(cluster.address, {}) as engine:
                for _ in engine.run(pause, [(0, 0.1), (1, 0.1)], deadline=lambda _: LONG):
                    pass
                owners = [[psutil.Process(process.pid)] for process in (cluster.scheduler, worker)]
                before = [cpu(owner) for owner in owners]
                for _ in engine.run(pause, [(0, seconds), (1, seconds)], deadline=lambda _: LONG):
                    pass
                after = [cpu(owner) for owner in owners]
        scheduler, both = ((end - start) / seconds for end, start in zip(after, before, strict=True))
        print(f"{name:30}{scheduler:12.1%}{both / 2:12.1%}")


if __name__ == "__main__":
    main()
