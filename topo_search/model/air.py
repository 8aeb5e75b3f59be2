"""Air speeds, as in `air` of `audit.json`, by the jet model: time averages in free air.

There are no walls, ground, ceiling or wind. The speed at a point is the sum of the modules' speeds there, an upper
bound for the sum of their velocities; the estimate is Reichardt's superposition of momenta, the root of the sum of
squares.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.kinds import Index, Omitted, Size
from topo_search.model.proven import upper_text
from topo_search.model.value import Value


class RegionAir(Value):
    """Air speeds in the region of an exposure requirement in one load case."""

    name: str
    """Name of the requirement."""
    speed_m_s: Size
    """Largest speed found at a point of the region [m/s]."""
    speed_at_most_m_s: Size
    """Proven upper bound of the speed in the region, by the model [m/s]."""
    estimate_m_s: Size
    """Reichardt's estimate at the point of `speed_m_s` [m/s]."""
    limit_m_s: Size | None = None
    """Limit, the requirement's `speed` [m/s]; None without one."""
    status: Literal["clear", "undecided", "violated"] | None = None
    """Verdict on the limit; None without a limit."""


class RotorAir(Value):
    """Average wake of other modules through a rotor's disc."""

    module: Index
    rotor: Index
    ingested_m_s: Size
    """Sum of the speeds of their jets [m/s]."""
    thrust_loss: Annotated[float, Field(strict=True, ge=0, le=1)]
    """Share of the rotor's thrust lost."""
    lost_N: Omitted[Size] = None
    """Thrust lost [N]; None in older audits."""


class CaseAir(Value):
    """Air speeds in one load case."""

    name: str
    """Name of the load case."""
    tip_m_s: Size
    """Speed at the end-effector [m/s]."""
    tip_estimate_m_s: Size
    """Reichardt's estimate at the end-effector [m/s]."""
    regions: tuple[RegionAir, ...] = ()
    """One entry per exposure requirement."""
    rotors: tuple[RotorAir, ...] = ()


FAST_AIR = 3.0
"""Speed of the air over a region without a limit from which answers warn [m/s]."""


class FastAir(Value):
    """Fast air over a region without a limit on air speed, in its worst load case."""

    exposure: Index
    """Number of the requirement."""
    case: str
    """Name of the load case."""
    speed_at_most_m_s: Size
    """Same as in `RegionAir`."""


class AirSpeeds(Value):
    """Air speeds in every load case, in the order of the task."""

    cases: tuple[CaseAir, ...]

    @property
    def tip_m_s(self) -> float:
        """Largest speed at the end-effector [m/s]."""
        return max(case.tip_m_s for case in self.cases)

    @property
    def region_m_s(self) -> float | None:
        """Proven upper bound of the speed in all regions [m/s]; None without regions."""
        return max((region.speed_at_most_m_s for case in self.cases for region in case.regions), default=None)

    @property
    def fast(self) -> tuple[FastAir, ...]:
        """Regions without a limit whose air may move at FAST_AIR or more."""
        over = zip(*(case.regions for case in self.cases), strict=True)
        worst = (
            max(zip(regions, self.cases, strict=True), key=lambda pair: pair[0].speed_at_most_m_s)
            for regions in over
        )
        return tuple(
            FastAir(exposure=number, case=case.name, speed_at_most_m_s=region.speed_at_most_m_s)
            for number, (region, case) in enumerate(worst)
            if region.limit_m_s is None and region.speed_at_most_m_s > FAST_AIR
        )

    @property
    def worst_rotor(self) -> tuple[CaseAir, RotorAir] | None:
        """Rotor that loses the most thrust to wakes, with its load case; None without losses."""
        rotors = ((case, rotor) for case in self.cases for rotor in case.rotors)
        worst = max(rotors, key=lambda pair: (pair[1].lost_N or 0.0, pair[1].thrust_loss), default=None)
        return worst if worst is not None and worst[1].thrust_loss > 0 else None

    def sentences(self) -> Iterator[str]:
        """Yield sentences about the largest speeds: at the end-effector, in each region, through a rotor."""
        tip = max(self.cases, key=lambda case: case.tip_m_s)
        yield f"air at the tip: {upper_text(tip.tip_m_s, 3)} m/s by the jet model, in {tip.name}"
        for number, region in enumerate(tip.regions):
            case = max(self.cases, key=lambda case: case.regions[number].speed_at_most_m_s)
            fastest = case.regions[number]
            limit = "" if fastest.limit_m_s is None else f", allowed {fastest.limit_m_s:g} m/s: {fastest.status}"
            if number in {air.exposure for air in self.fast}:
                limit = f"; envelopes do not limit speed, exposure[{number}].speed does"
            yield (
                f"air over {region.name}: at most {upper_text(fastest.speed_at_most_m_s, 3)} m/s, "
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
    """Largest speeds on the airflow envelope of a single module in free air, proven to 0.1 % for the model."""

    side_m_s: Size
    """On the side of the cone [m/s]."""
    side_merged_m_s: Size | None
    """The same below the point where the rotors' jets merge [m/s]; None if the side ends above it."""
    end_m_s: Size
    """On the far ball [m/s]."""
    rotor_plane_m_s: Size
    """In the plane of the rotors, outside the envelope [m/s]."""


class SpeedEnvelope(Value):
    """Cone-sphere around all air of a module above a speed; the smallest one, to a percent."""

    start_radius_m: Size
    spread_angle_deg: Size
    reach_m: Size
    volume_m3: Size
    least_volume_m3: Size
    """Lower bound for the volume of such a cone-sphere that starts at the module's centre and widens downwards."""
