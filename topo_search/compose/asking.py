"""Answers without a search: about a task, the air of a module, a vehicle, or the flight of a design."""

from __future__ import annotations

import math
import textwrap
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Literal

from topo_search.compose.binding import enclose_speed, envelope_of_speed
from topo_search.compose.designs import audit, read_completed
from topo_search.model import BadInput, Design, Fault, Module, Task
from topo_search.model.air import EnvelopeAir, SpeedEnvelope
from topo_search.model.features import ModuleType
from topo_search.model.files import write_atomically
from topo_search.model.flying import scaled_defaults
from topo_search.model.html import heading, table
from topo_search.model.module import AIR_DENSITY
from topo_search.model.proven import at_least, lower_text, upper_text
from topo_search.model.task_file import read_task
from topo_search.model.vehicle import Capability, Vehicle, read_vehicle
from topo_search.report.cell import View
from topo_search.report.task_facts import facts, goals, load_cases
from topo_search.report.task_warnings import UNIT_IN_DOUBT, TaskWarning, task_warnings
from topo_search.report.wording import figures, quantity
from topo_search.simulation.result import FlightResult, ScenarioResult
from topo_search.study import Request
from topo_search.study.answer import quotient_remark
from verify.air.envelope import envelope_air


@dataclass(frozen=True)
class CheckedTask:
    """A task in words, as `topo-search check` prints it."""

    task: Task
    sizes: list[dict[str, Any]]
    """For each number of modules: candidates, bound on effort, and why it is impossible, if it is."""
    warnings: tuple[TaskWarning, ...]
    """Suspicious values."""

    def __str__(self) -> str:
        """Return the requirements in words, warnings first."""
        return "\n".join(chain([self.task.name], *(_group(title, rows) for title, rows in self._groups())))

    def __repr__(self) -> str:
        return f"<check of {self.task.name}: {quantity(len(self.warnings), 'warning')}; print it>"

    def _repr_html_(self) -> str:
        groups = (heading(title) + table(("", ""), rows) for title, rows in self._groups())
        return heading(self.task.name) + "".join(groups)

    def _groups(self) -> Iterator[tuple[str, Iterable[tuple[str, str]]]]:
        if self.warnings:
            yield "warnings", self.warnings
        doubted = (one.path.startswith("module.") and UNIT_IN_DOUBT in one.words for one in self.warnings)
        yield from _requirements(self.task, plausible=not any(doubted))
        title = "search, and a bound on control effort if every wrench is met exactly"
        yield title, expectations(self.sizes)


@dataclass(frozen=True)
class ModuleAir:
    """The smallest envelope of all air of a module at least as fast as a speed, and its present envelope."""

    speed_m_s: float
    thrust_to_weight: float
    """Thrust of the module over its weight."""
    thrust_N: float
    smallest: SpeedEnvelope
    """The smallest envelope."""
    present: EnvelopeAir
    """Largest speeds on the module's present envelope."""

    def __str__(self) -> str:
        """Return both envelopes in words."""
        smallest = self.smallest
        volume, bound = upper_text(smallest.volume_m3, 4), lower_text(smallest.least_volume_m3, 4)
        thrust = f"{self.thrust_to_weight:.4g} times the weight of a module, {self.thrust_N:.4g} N"
        lines = [
            f"at {thrust}, all air of {self.speed_m_s:g} m/s and more is inside",
            f"  start_radius = {upper_text(smallest.start_radius_m, 5)}",
            f"  spread_angle_deg = {upper_text(smallest.spread_angle_deg, 5)}",
            f"  reach = {upper_text(smallest.reach_m, 5)}",
            f"a volume of {volume} m³; none is below {bound} m³",
            "largest speeds on the present envelope",
            *(f"  {name:14} {words}" for name, words in speeds_on(self.present)),
        ]
        return "\n".join(lines)

    __repr__ = __str__


class PlayedFlight(FlightResult):
    """Flights of a design, which its 3-D view plays."""

    _design: Design
    _series: str

    def view(self) -> View:
        """Return the 3-D view of the design with its flights: choose one, and move its time slider."""
        from topo_search.report.design_page import course_of, flights_of

        flights = flights_of(course_of(self._series), self)
        return View.of(self._design, audit(self._design), flights)


def check(task: Task | str | Path) -> CheckedTask:
    """Explain a task in words, and warn about suspicious values; nothing is solved.

    Args:
        task: a task, its file, or the name of a shipped example.

    Raises:
        BadInput: the task is invalid.

    Example:
        >>> from topo_search import check
        >>> check("push")
        <check of push: 3 warnings; print it>
    """
    user_task = enclose_speed(task if isinstance(task, Task) else read_task(task))
    return CheckedTask(user_task, [_size(user_task, n) for n in user_task.sizes], task_warnings(user_task))


def airflow(task: Task | str | Path | None = None, *, speed: float, at: float | str = "hover") -> ModuleAir:
    """Enclose the air of one module that is at least as fast as a speed, by the jet model.

    Args:
        task: its `[module]` is taken: a task, its file, or the name of a shipped example; None: the default module.
        speed: air speed [m/s], above 0.
        at: thrust of the module: "hover", "full", or its multiple of the module's weight.

    Raises:
        BadInput: no air is that fast, rotors are tilted, or the thrust is out of range.

    Example:
        >>> from topo_search import airflow
        >>> print(airflow("push-local", speed=2.0).smallest.start_radius_m > 0)
        True
    """
    module, density, gravity = Module(), AIR_DENSITY, Task.model_fields["gravity"].default
    if task is not None:
        named = enclose_speed(task if isinstance(task, Task) else read_task(task))
        module, density, gravity = named.module, named.air_density, named.gravity
        if not module.rotor_table.is_parallel:
            rule = "must blow along the module's axis for the envelope of a speed"
            raise BadInput(named.name if isinstance(task, Task) else str(task), [Fault("module.rotors", rule)])
    if not speed >= 1e-6:
        raise BadInput("--speed", f"must be at least 1e-06 m/s, but got {speed}")
    ratio = _thrust_to_weight(at, module.max_thrust_to_weight)
    smallest = envelope_of_speed(module, density, gravity, speed, ratio, source="--speed")
    thrust = ratio * module.mass * gravity
    return ModuleAir(speed, ratio, thrust, smallest, envelope_air(module, density, thrust))


def capability(vehicle: Vehicle | str | Path, task: Task | str | Path | None = None) -> Capability:
    """Prove what any vehicle with fixed rotors can do, as the audit does for a design.

    Args:
        vehicle: a vehicle, its file, or a table of rotors.
        task: a task to judge it by, its file, or the name of a shipped example; a unit of weight is the
            vehicle's.

    Raises:
        BadInput: a file is invalid, or mass or dimensions are too large to compute with.

    Example:
        >>> from topo_search import capability, export_design, read_design
        >>> _ = export_design(read_design("hover-2/best.json"), "rotors.csv", format="rotors")
        >>> capability("rotors.csv").rank
        5
    """
    from verify.flight.vehicle import capability as capability_of

    loaded = vehicle if isinstance(vehicle, Vehicle) else read_vehicle(str(vehicle))
    result = capability_of(loaded, task if task is None or isinstance(task, Task) else read_task(task))
    if result is None:
        source = "vehicle" if isinstance(vehicle, Vehicle) else str(vehicle)
        raise BadInput(source, "must have wrenches to compute with, but its mass or dimensions are too large")
    return result


def fly(
    design: Design | str | Path,
    *,
    noise: float = 1.0,
    model_error: float = 0.0,
    seed: int = 0,
    rotor_out: bool = False,
    detection_time: float = 0.1,
    allocator: Literal["bounded", "pseudo-inverse"] = "bounded",
    wake: bool = True,
    only: tuple[str, ...] = (),
    out: str | Path | None = None,
    video: str | Path | None = None,
    tell: Callable[[ScenarioResult], None] = lambda _: None,
) -> PlayedFlight:
    """Fly a design in closed-loop simulation with rotor limits, motor lag and noise; needs the extra `sim`.

    Args:
        design: a design or its file.
        noise: factor on the sensor noise, 0 to 100.
        model_error: relative standard deviation of masses and thrusts from the controller's model, 0 to 0.5.
        seed: seed of noise and errors.
        rotor_out: whether a rotor failure must be survived even if the task does not require it.
        detection_time: time until the controller knows that a rotor has failed [s], 0 to 10.
        allocator: thrusts by least squares within limits, or by PX4's rule.
        wake: whether wakes of other modules reduce thrust.
        only: prefixes of the scenarios to fly; empty: all.
        out: folder for flight.json, flight.csv and flight.png; None: none.
        video: animated .gif or .webp of some flights, 1280 x 720; None: none.
        tell: called with each scenario when it has been flown.

    Raises:
        BadInput: the design cannot hover, a value is out of range, no scenario has such a name, or the video cannot
            be rendered.

    Example:
        >>> from topo_search import fly
        >>> fly("hover-2/best.json", only=("hover",), wake=False).scenarios[0].name
        'hover'
    """
    ranges = {"noise": (noise, 100), "model_error": (model_error, 0.5), "detection_time": (detection_time, 10)}
    for name, (value, largest) in ranges.items():
        if not 0 <= value <= largest:
            raise BadInput(name, f"must be from 0 to {largest:g}, but got {value}")
    if allocator not in ("bounded", "pseudo-inverse"):
        raise BadInput("allocator", f'must be "bounded" or "pseudo-inverse", but got {allocator}')
    completed = design if isinstance(design, Design) else read_completed(design)
    from topo_search.simulation import files

    film = None if video is None else files.film(Path(video), files.radius(completed))
    from topo_search.simulation.campaign import fly_all
    from topo_search.simulation.controller import Allocator, PseudoInverseAllocator
    from topo_search.simulation.fly import Options
    from topo_search.simulation.plant import ModelErrors

    rule = PseudoInverseAllocator if allocator == "pseudo-inverse" else Allocator
    options = Options(ModelErrors(model_error, noise, seed), detection=detection_time, allocator=rule, wake=wake)
    watch = (lambda scenario: None) if film is None else (lambda scenario: film.watch(scenario.name))
    campaign = fly_all(completed, options, rotor_out=rotor_out, only=only, tell=tell, watch=watch)
    if out is not None:
        files.write_flight(campaign, Path(out))
    if video is not None and film is not None:
        write_atomically(Path(video), film.encode(Path(video).suffix.lower()))
    played = PlayedFlight.model_validate(dict(campaign.result))
    played._design, played._series = completed, files.time_series(campaign.flown)
    return played


def _requirements(task: Task, *, plausible: bool) -> Iterator[tuple[str, Iterable[tuple[str, str]]]]:
    """Yield the requirements of a task in groups, with the unit of weight for every number of modules.

    The air of a module without plausible sizes is left out: it takes long and means nothing.
    """
    first, *larger = (task.resolve(n) for n in task.sizes)
    yield from facts(first, *larger)
    if plausible and any(exposure.geometry for exposure in first.exposure):
        for kind in first.types:
            if kind.rotor_table.count:
                speeds = speeds_on(envelope_air(kind, first.air_density, kind.mass * first.gravity))
                of = f"a module `{kind.name}`" if isinstance(kind, ModuleType) else "one module"
                yield f"air of {of} in hover, on its envelope for regions: at most", speeds
    if free := [f"exposure[{k}].speed" for k, exposure in enumerate(task.exposure) if exposure.speed is None]:
        yield "air speed over regions", [("not limited", f"by envelopes; to limit it, state {', '.join(free)}")]
    if task.goals.names:
        yield goals(task)
    size = f" of {quantity(first.n, 'module')}" if larger else ""
    cases = [(f"load case {k}", f"{wrench}; weight {weight}") for k, wrench, weight in load_cases(first)]
    yield f"load cases{size}, each the total wrench of the rotors", cases


def expectations(sizes: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield the figures of `_size` in words."""
    yield from (("trees", quotient) for quotient in dict.fromkeys(size["quotient"] for size in sizes))
    for size in sizes:
        bound = f"J at least {figures(at_least(size['lower_bound'], 3))} rad⁴/s⁴, whatever the topology"
        effort = f"impossible: {size['impossible']}" if size["impossible"] else bound
        if (share := size["defaults_share"]) is not None:
            held = (
                f"{100 * share:.0f} % of the side force, tilt and acceleration that flying tasks ask for by default"
            )
            effort += f"; {held} are not excluded; if no size holds them, the answer is fragile"
        yield quantity(size["modules"], "module"), f"{quantity(size['candidates'], 'candidate')}; {effort}"


def _group(title: str, rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield the lines of named values below their title, wrapped."""
    yield f"\n{title}"
    for name, value in rows:
        first, rest = f"  {name:38} ", " " * 41
        yield from textwrap.wrap(value, 120, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)


def _size(task: Task, n: int) -> dict[str, Any]:
    """Return the number of candidates and the bound on effort for n modules; nothing is solved."""
    from nlp import lower_bound, prove_impossible

    request, resolved = Request(task, "task", starts=1, seed=0), task.resolve(n)
    proof, share = prove_impossible(resolved), None
    if proof is not None and task.flight.filled and prove_impossible(scaled_defaults(task, 0.0).resolve(n)) is None:

        def is_excluded(twentieths: int) -> bool:
            return prove_impossible(scaled_defaults(task, twentieths / 20).resolve(n)) is not None

        share = bisect_left(range(1, 20), True, key=is_excluded) / 20
    return {
        "modules": n,
        "candidates": request.space(n).count(),
        "quotient": quotient_remark(request.quotient(n)),
        "lower_bound": lower_bound(resolved),
        "impossible": proof and proof.message,
        "defaults_share": share,
    }


def speeds_on(envelope: EnvelopeAir) -> Iterator[tuple[str, str]]:
    """Yield the largest air speeds on the envelope of one module, each with its location."""
    yield "side", f"{upper_text(envelope.side_m_s, 3)} m/s"
    if envelope.side_merged_m_s is not None:
        yield "side, merged", f"{upper_text(envelope.side_merged_m_s, 3)} m/s"
    yield "far end", f"{upper_text(envelope.end_m_s, 3)} m/s"
    yield "rotor plane", f"{upper_text(envelope.rotor_plane_m_s, 3)} m/s, outside it"


def _thrust_to_weight(at: float | str, largest: float) -> float:
    """Return the thrust over the weight that `at` names."""
    try:
        ratio = {"hover": 1.0, "full": largest}.get(str(at)) or float(at)
    except ValueError:
        ratio = math.nan
    if not 0 < ratio <= largest:
        rule = f'must be "hover", "full" or a thrust over the weight, above 0 and at most {largest:g}'
        raise BadInput("--at", f"{rule}, but got {at}")
    return ratio
