"""Options of the search."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from topo_search.limits import LIMITS
from topo_search.model import kinds
from topo_search.model.value import Broken, Value, show

BodyClearance = Annotated[kinds.Positive | Literal[False], kinds.OneOf("must be a length or false")]

MIN_STEP_DEG = LIMITS.angle_steps[0]
"""Smallest difference of two hinge angles of a set, and smallest step [deg]: the precision of brackets."""


def _check_apart(angles: tuple[float, ...]) -> tuple[float, ...]:
    for low, high in pairwise(sorted(angles)):
        if high - low < MIN_STEP_DEG:
            raise ValueError(f"must differ by {MIN_STEP_DEG:g} deg or more, but got {show([low, high])}")
    return tuple(angle + 0.0 for angle in angles)  # -0.0 becomes 0.0


Angles = Annotated[
    tuple[kinds.Angle, ...], kinds.at_most(LIMITS.hinge_angles), kinds.NonEmpty, AfterValidator(_check_apart)
]


Maximized = Literal["force_reserve", "torque_reserve", "load", "payload"]


class Search(Value):
    """Options of the search and the solver."""

    root: Literal["free", "paper"] = "free"
    """`free`: any root orientation; `paper`: psi = 0 and both angles within +-90 deg."""
    root_orientation_deg: kinds.Omitted[kinds.Vector] = None
    """The root's psi, alpha_0 and alpha_1, R = Rz(psi) Rx(alpha_0) Ry(alpha_1) [deg]; default: found by the
    search."""
    connectors: Literal["aligned", "any"] = "aligned"
    """`aligned`: parent port a meets child port a + 2; `any`: any port of the child."""
    lattice: kinds.Omitted[Literal["flat"]] = None
    """`flat`: all hinges are 0 and all neighbours on a square grid are bolted together, cycles included; default:
    trees."""
    closures: kinds.Omitted[kinds.Index] = None
    """Number of joints of a lattice beyond those of a tree. Set in designs, not in tasks."""
    # Of 1,000 designs solved without a margin the worst overlaps by 8.5e-10 m; a margin of 1.1e-8 m would have made
    # all of them clear (tests/benchmarks/smooth_error.py). The default is much larger: it costs 0.013 % of the
    # effort where measured, and leaves room for larger modules and for checks less exact than the audit.
    margin: kinds.NonNegative = 1.0e-4
    """Clearance that the solver adds to every geometric requirement [m]."""
    interference: Literal["airflow", "parts", "separation"] = "airflow"
    """`airflow`: envelopes of two modules must not overlap; `parts`: they may merge, but rotors, hubs and arms stay
    out of other modules' envelopes; `separation`: the paper's ablation, a minimum distance of module centres."""
    separation: kinds.Positive | None = None
    """Minimum distance of module centres in the ablation [m]; default: 2 arm_length."""
    peak_input: Annotated[kinds.Positive, Field(le=1, exclude_if=lambda given: given == 1.0)] = 1.0
    """Largest squared speed of a rotor in a load case, as a share of u_max."""
    body_clearance: BodyClearance | None = None
    """Minimum distance of centres of modules not bolted together [m]; default: 2 (arm_length + rotor_radius); or
    false."""
    centre_margin: kinds.Omitted[kinds.NonNegative] = None
    """Margin of these centres [m] beyond what errors within [tolerances] take, at most `margin` in all; default: as
    much as `margin`. A run that raises `margin` for tolerances sets it."""
    hinge_step_deg: kinds.Omitted[Annotated[float, Field(strict=True, ge=MIN_STEP_DEG, le=90)]] = None
    """Hinge angles are multiples of this step within +-90 deg [deg]; default: any angle."""
    hinge_angles_deg: kinds.Omitted[Angles] = None
    """Hinge angles are these values of either sign [deg]; an alternative to a step."""
    maximize: kinds.Omitted[Maximized] = None
    """The best platform has the largest value of this quantity, not the least effort: `force_reserve`,
    `torque_reserve`, `load`: a factor of all wrenches at the end-effector, or `payload`: a mass carried there."""
    reached: kinds.Omitted[kinds.NonNegative] = None
    """Value of that quantity [N, N m, 1, kg]. Set in designs, not in tasks."""
    towards: Annotated[tuple[kinds.Vector, ...], kinds.OMIT_EMPTY] = ()
    """Directions in which the solver asks for a maximised reserve: it adds those in which designs are weakest."""

    @property
    def least_margin(self) -> float:
        """Smallest margin that every clearance between modules keeps, which the solver's proofs use [m]."""
        return self.margin if self.centre_margin is None else min(self.margin, self.centre_margin)

    @property
    def root_ranges(self) -> dict[str, tuple[float, float]]:
        """Ranges of the root's angles, so that it matters which module is the root [rad]; empty: any attitude."""
        tilts, ranges = (-math.pi / 2, math.pi / 2), list[tuple[float, float]]()
        if self.root_orientation_deg is not None:
            ranges = [(angle, angle) for angle in map(math.radians, self.root_orientation_deg)]
        elif self.root == "paper":
            ranges = [(0.0, 0.0), tilts, tilts]
        return dict(zip(("psi", "alpha_0", "alpha_1"), ranges, strict=False))

    @property
    def hinge_set_deg(self) -> tuple[float, ...] | None:
        """Allowed hinge angles in ascending order, both signs of each [deg]; None if any angle is allowed.

        A hinge angle [rad] is exactly `math.radians` of one of them.
        """
        angles = self.hinge_angles_deg if self.lattice is None else (0.0,)
        if self.hinge_step_deg is not None:
            steps = math.floor(90 / self.hinge_step_deg * (1 + 1e-12))  # 90 is a multiple of 0.9 = 90 / 100
            angles = tuple(min(k * self.hinge_step_deg, 90.0) for k in range(steps + 1))
        if angles is None:
            return None
        return tuple(sorted({-angle for angle in angles if angle} | set(angles)))

    @property
    def any_angle(self) -> Search:
        """Options without a set of hinge angles."""
        return self.model_copy(update={"hinge_step_deg": None, "hinge_angles_deg": None})

    def _broken_rules(self) -> Broken:
        if (given := self.root_orientation_deg) is not None:
            if self.root == "paper":
                yield "root_orientation_deg", f'must be left out with root = "paper", but got {show(given)}'
            if any(abs(angle) > limit for angle, limit in zip(given, (180, 90, 180), strict=True)):
                rule = "must be psi within +-180, alpha_0 within +-90 and alpha_1 within +-180"
                yield "root_orientation_deg", f"{rule}, but got {show(given)}"
        if self.hinge_step_deg is not None and self.hinge_angles_deg is not None:
            text = f"must be left out if hinge_angles_deg is given, but got {self.hinge_step_deg:g}"
            yield "hinge_step_deg", text
        if self.interference == "separation" and self.body_clearance:
            text = f'must be false or left out with interference = "separation", but got {self.body_clearance}'
            yield "body_clearance", text
