"""The exact audit of a design; shares no code with the solver.

`audit(design)` derives everything again from a design alone; `choose_mount(design)` finds the connector from which
a straight rod reaches the end-effector; `poses` is the audit's own forward kinematics; `check_chunk` checks a part
of a proof by branch and bound. All load on first use, so that importing this package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from verify.assembly import choose_mount
    from verify.design_audit import audit
    from verify.kinematics import Poses, poses
    from verify.proof.check import check_chunk, prepare_check

__all__ = ["Poses", "audit", "check_chunk", "choose_mount", "poses", "prepare_check"]


def __getattr__(name: str) -> Any:
    """Load a public name on its first use (PEP 562)."""
    if name == "audit":
        from verify.design_audit import audit

        return audit
    if name == "choose_mount":
        from verify.assembly import choose_mount

        return choose_mount
    if name in {"check_chunk", "prepare_check"}:
        from verify.proof import check

        return getattr(check, name)
    if name in {"Poses", "poses"}:
        from verify import kinematics

        return getattr(kinematics, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
