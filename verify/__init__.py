"""The exact audit of a design; shares no code with the solver.

`audit(design)` derives everything again from the design alone. `choose_mount(design)` finds the connector from
which a straight rod reaches the end-effector. `complete(geometry)` adds the best inputs to a geometry. `poses` is
the audit's own forward kinematics. `check_chunk` checks one part of a branch-and-bound proof. Each name loads on
first use, so importing this package is cheap.
"""

from importlib import import_module
from typing import Any

_MODULES = {
    "Poses": "kinematics", "audit": "design_audit", "case_reserves": "flight.analysis",
    "check_chunk": "proof.check", "choose_mount": "assembly",
    "complete": "bare", "poses": "kinematics", "prepare_check": "proof.check",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load a public name on its first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"verify.{_MODULES[name]}"), name)
