"""Public names of the audit."""

from verify.assembly import choose_mount
from verify.bare import complete
from verify.design_audit import audit
from verify.flight.analysis import case_reserves
from verify.kinematics import Poses, poses
from verify.proof.check import check_chunk, prepare_check

__all__ = ["Poses", "audit", "case_reserves", "check_chunk", "choose_mount", "complete", "poses", "prepare_check"]
