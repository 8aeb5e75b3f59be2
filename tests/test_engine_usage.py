import subprocess
import sys

import numpy as np

from topo_search.supervisor import Clock, peak_mb

BLOCK_MB = 400.0
SAY = "from topo_search.supervisor import peak_mb; print(peak_mb())"


def test_a_process_counts_its_own_memory_and_not_that_of_its_parent():
    before = peak_mb()
    assert np.ones(int(BLOCK_MB * 2**20 / 8)).nbytes / 2**20 == BLOCK_MB
    assert peak_mb() > BLOCK_MB
    assert peak_mb() >= before
    child = float(subprocess.run([sys.executable, "-c", SAY], check=True, capture_output=True).stdout)
    assert 5 < child < BLOCK_MB / 2


def test_a_lap_begins_where_the_last_one_ended():
    clock = Clock()
    assert sum(range(3_000_000)) > 0
    worked, rested = clock.lap(), clock.lap()
    assert worked > rested >= 0
