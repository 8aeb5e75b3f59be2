"""What an end-effector at the centre of mass costs, against one whose place is optimised too.

At the centre of mass it must still keep its distance from every module's centre, so that the platform has to leave
a hole there; `com, inside allowed` drops that (`end_effector.exclusion = false`), as if a module could be in the
same place. The cone of an exterior requirement has no axis there, so that this class cannot take part.
"""

from __future__ import annotations

from topo_search.experiments.cell import Variant
from topo_search.experiments.comparison import Comparison
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings

AT_COM = 'end_effector.position="com"'

COMPARISON = Comparison(
    (
        Variant("free"),
        Variant("com", (AT_COM,)),
        Variant("com, inside allowed", (AT_COM, "end_effector.exclusion=false")),
    ),
    "What an end-effector at the centre of mass costs: each point a tree, compared with itself",
)

EXPERIMENT = Experiment(
    name="placement",
    question="What does an end-effector at the centre of mass cost, compared with an optimised position?",
    full=Settings(
        tasks=(("push", (5,)), ("push-local", (5,)), ("push-directional", (5,)), ("ten-wrenches", (10, 20))),
        topologies=(50, 10),
        starts=24,
    ),
    small=Settings(tasks=(("push", (3,)),), topologies=(4, 4), starts=2),
    cells=COMPARISON.cells,
    summary=COMPARISON.summary,
    findings=COMPARISON.findings,
    figure=COMPARISON.figure,
)
