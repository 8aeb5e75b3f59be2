"""Which tasks the reduced search expresses."""

from __future__ import annotations

from topo_search.model import ResolvedTask

REDUCED_UP_TO = 9
"""Most modules for which the reduced search leads; with more, starts are untangled and solved in rounds.

Ten wrenches, ten trees of 12 and of 20 modules: the steps of a descent grow with the square of the modules, and its
ends with many modules miss what untangled starts do not.
"""


def reason_against(task: ResolvedTask) -> str | None:
    """Return why the reduced search does not express a task; None if it does."""
    if task.n > REDUCED_UP_TO:
        return f"more than {REDUCED_UP_TO} modules are placed before they descend"
    if len(task.folds(task.search.margin)) != 1:
        return "hinges have no clear fold, or several between which no descent leads"
    return None
