"""The paper's studies and further ones: many topologies solved under varied conditions, measured and summarised.

An experiment is a list of cells, each one topology under one condition. Cells are measured in worker processes, and
each row is written to disk at once, so that a stopped experiment can be resumed.
"""

from topo_search.experiments.conducting import Experiment, conduct, results
from topo_search.experiments.plan import Settings


def experiment(name: str) -> Experiment:
    """Return an experiment: `scaling`, `ablation`, `placement`, `root`, `body` or `hinges`."""
    from topo_search.experiments.comparisons import COMPARISONS
    from topo_search.experiments.paper import PAPER_STUDIES

    return {study.name: study for study in (*PAPER_STUDIES, *COMPARISONS)}[name]
