"""What it costs that frames keep clear of each other, where the paper lets airflow alone keep them apart.

`airflow only` has the paper's clearances, `search.body_clearance = false`; `body clearance` asks for the
default distance of the centres of modules that are not bolted together.
"""

from __future__ import annotations

from topo_search.experiments.cell import AIRFLOW_ALONE, Variant
from topo_search.experiments.comparison import Comparison
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings

COMPARISON = Comparison(
    (Variant("airflow only", (AIRFLOW_ALONE,)), Variant("body clearance")),
    "What body clearance costs: each point a tree, compared with itself",
)
PUSH = ("push", "push-local", "push-directional", "push-exterior-60")

EXPERIMENT = Experiment(
    name="body",
    question="What does it cost to keep frames apart?",
    full=Settings(
        tasks=(*((task, (5,)) for task in PUSH), ("ten-wrenches", (10, 20))), topologies=(50, 10), starts=24
    ),
    small=Settings(tasks=(("push", (3,)),), topologies=(4, 4), starts=2),
    cells=COMPARISON.cells,
    summary=COMPARISON.summary,
    findings=COMPARISON.findings,
    figure=COMPARISON.figure,
)
