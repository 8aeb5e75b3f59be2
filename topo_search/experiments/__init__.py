"""The paper's studies and ours: many topologies solved under varied conditions, measured, summed up and drawn.

An experiment is a list of cells, each one topology under one condition. A cell is measured in a worker process, and
its row is on the disk before the next one counts, so that the same command goes on where it was stopped.
"""

from topo_search.experiments.conducting import Experiment, conduct, experiment
from topo_search.experiments.folder import results
from topo_search.experiments.plan import Settings

__all__ = ["Experiment", "Settings", "conduct", "experiment", "results"]
