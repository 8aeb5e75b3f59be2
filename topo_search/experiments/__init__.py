"""The paper's studies and further ones: many topologies solved under varied conditions, measured and summarised.

A study is a list of cells, each one topology under one condition. `conduct` solves, audits and times them in worker
processes; every row goes to disk at once. A study's `summary` and `figure` are functions of its rows.
"""

from topo_search.experiments.paper import growth, style
from topo_search.experiments.study import Settings, Study, conduct, results


def experiment(name: str) -> Study:
    """Return a study: `scaling`, `ablation`, `placement`, `root`, `body` or `hinges`."""
    from topo_search.experiments.comparisons import COMPARISONS
    from topo_search.experiments.paper import PAPER_STUDIES

    return {study.name: study for study in (*PAPER_STUDIES, *COMPARISONS)}[name]
