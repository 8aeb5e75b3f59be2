"""The paper's studies and ours: many topologies solved under varied conditions, measured, summed up and drawn.

An experiment is a list of cells, each one topology under one condition. A cell is measured in a worker process, and
its row is on the disk before the next one counts, so that the same command continues where
it was stopped.
"""

from topo_search.experiments.conducting import Experiment, conduct, results
from topo_search.experiments.plan import Settings


def experiment(name: str) -> Experiment:
    """Return an experiment: `scaling`, `ablation`, `placement`, `root`, `body` or `hinges`."""
    from topo_search.experiments.comparisons import COMPARISONS
    from topo_search.experiments.paper import PAPER_STUDIES

    return {one.name: one for one in (*PAPER_STUDIES, *COMPARISONS)}[name]
