"""The air of a design by the jet model, as `air` of `audit.json` holds it, in m/s.

Speeds are time averages in free air: no wall, ground, ceiling or wind. The speed at a point is the sum of the
modules' speeds there, which no sum of their velocities exceeds; the estimate is Reichardt's sum of their momenta,
the root of the sum of squares.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.proven import upper_text
from topo_search.model.value import Index, Value

Speed = Annotated[float, Field(strict=True, ge=0)]
"""[m/s]"""


class RegionAir(Value):
    """The air over the region of one exposure requirement in one load case."""

    name: str
    speed_m_s: Speed
    """Speed at a point of the region, the largest that was found."""
    speed_at_most_m_s: Speed
    """Proven of the model: no point of the region has more."""
    estimate_m_s: Speed
    """Reichardt's estimate at the point of `speed_m_s`."""
    limit_m_s: Speed | None = None
    """The requirement's `speed`."""
    status: Literal["clear", "undecided", "violated"] | None = None
    """Verdict on the limit; None without one."""


class RotorAir(Value):
    """Wakes of other modules through a rotor's disc, on average."""

    module: Index
    rotor: Index
    ingested_m_s: Speed
    """Sum of the speeds of their jets."""
    thrust_loss: Annotated[float, Field(strict=True, ge=0, le=1)]
    """Share of the rotor's thrust lost."""


class CaseAir(Value):
    """The air in one load case."""

    name: str
    tip_m_s: Speed
    """Speed at the end-effector."""
    tip_estimate_m_s: Speed
    """Reichardt's estimate there."""
    regions: tuple[RegionAir, ...] = ()
    """One an exposure requirement."""
    rotors: tuple[RotorAir, ...] = ()


class AirSpeeds(Value):
    """The air in every load case, in the order of the task's."""

    cases: tuple[CaseAir, ...]

    @property
    def tip_m_s(self) -> float:
        """Largest speed at the end-effector."""
        return max(case.tip_m_s for case in self.cases)

    @property
    def region_m_s(self) -> float | None:
        """Proven bound of the speed over all regions; None without regions."""
        return max((region.speed_at_most_m_s for case in self.cases for region in case.regions), default=None)

    @property
    def worst_rotor(self) -> tuple[CaseAir, RotorAir] | None:
        """The rotor that loses the largest share of its thrust to wakes; None if none does."""
        rotors = ((case, rotor) for case in self.cases for rotor in case.rotors)
        worst = max(rotors, key=lambda pair: pair[1].thrust_loss, default=None)
        return worst if worst is not None and worst[1].thrust_loss > 0 else None

    def sentences(self) -> Iterator[str]:
        """Yield the largest speeds: at the end-effector, over each region, through a rotor."""
        tip = max(self.cases, key=lambda case: case.tip_m_s)
        yield f"air at the tip: {upper_text(tip.tip_m_s, 3)} m/s by the jet model, in {tip.name}"
        for number, region in enumerate(tip.regions):
            case = max(self.cases, key=lambda case: case.regions[number].speed_at_most_m_s)
            found = case.regions[number]
            limit = "" if found.limit_m_s is None else f", allowed {found.limit_m_s:g} m/s: {found.status}"
            yield (
                f"air over {region.name}: at most {upper_text(found.speed_at_most_m_s, 3)} m/s, "
                f"in {case.name}{limit}"
            )
        if (worst := self.worst_rotor) is not None:
            case, rotor = worst
            yield (
                f"wakes through rotors: {upper_text(rotor.ingested_m_s, 3)} m/s through rotor {rotor.rotor} of "
                f"module {rotor.module}, which loses {upper_text(100 * rotor.thrust_loss, 3)} % of its thrust, "
                f"in {case.name}"
            )


class EnvelopeAir(Value):
    """The largest speeds on a module's airflow envelope, alone in free air, proven of the model, to 0.1 %."""

    side_m_s: Speed
    """On the side of the cone."""
    side_merged_m_s: Speed | None
    """The same, from where the jets of the rotors have merged; None if the side ends above."""
    end_m_s: Speed
    """On the far ball."""
    rotor_plane_m_s: Speed
    """In the plane of the rotors, outside the envelope."""


class SpeedEnvelope(Value):
    """The smallest cone-sphere, to a percent, around all air of a module that is at least as fast as a speed."""

    start_radius_m: Speed
    spread_angle_deg: Speed
    reach_m: Speed
    volume_m3: Speed
    least_volume_m3: Speed
    """No cone-sphere around that air is smaller, if it starts at the module's centre and widens downwards."""
