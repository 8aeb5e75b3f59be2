"""Task: modules, end-effector, load cases, exposure requirements and options of the search.

| symbol | meaning | unit |
|---|---|---|
| n, K | numbers of modules and load cases | |
| r | number of rotors of a module; of types of module, the largest | |
| m_E, m_J | masses of the end-effector and of a joint | kg |
| m_t | total mass n m, or that of all types, + m_E + (n - 1) m_J, plus the rod's in a design that counts it | kg |
| p_E | end-effector position from the platform COM | m |
| W | task frame: axes of all vectors below | |
"""

from __future__ import annotations

import math
import re
from itertools import product
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from topo_search.limits import LIMITS
from topo_search.model import features, room
from topo_search.model.arrays import Array
from topo_search.model.end_effector import CountedRod, EndEffector, ResolvedEndEffector
from topo_search.model.exposure import LEAST_OFFSET, PART_NAMES, Exposure, needs_offset, segment_of
from topo_search.model.folds import Folds, intersect
from topo_search.model.kinds import OMIT_EMPTY, Count, Index, NonEmpty, OneOf, Positive, Vector, at_most, omit_if
from topo_search.model.load_case import LoadCase, broken_rules, labels, objects, ten_wrenches
from topo_search.model.module import AIR_DENSITY, PRECISION, Module
from topo_search.model.proven import FARTHEST_TIP, TOLERANCE
from topo_search.model.search import Search
from topo_search.model.shape import unit
from topo_search.model.topology import LETTERS, Topology
from topo_search.model.value import Broken, Value, every_field, refuse, show


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
        raise ValueError("must be 1 to 64 letters, digits, dots, dashes and underscores, a letter or digit first")
    return name


def _check_range(sizes: Any) -> Any:
    if len(sizes) != 2:
        raise ValueError("must be a whole number of modules or [fewest, most]")
    return sizes


Sizes = Annotated[
    Count | Annotated[tuple[Count, Count], BeforeValidator(_check_range)],
    OneOf("must be a whole number of modules or [fewest, most]"),
]
LoadCases = Annotated[
    Literal["ten-wrenches"] | Annotated[tuple[LoadCase, ...], at_most(LIMITS.load_cases), NonEmpty],
    OneOf('must be a list of load cases or "ten-wrenches"'),
]


class Task(Value):
    """Task of a user; `resolve` fills in every default for one number of modules."""

    name: Annotated[str, AfterValidator(_file_name)]
    """Letters, digits, dots, dashes and underscores; names the run folder."""
    modules: Sizes
    """Number of modules n, or [fewest, most]; the sum of all counts with `module_types`, by default."""
    gravity: Positive = 9.81
    """g [m/s^2]."""
    air_density: Annotated[Positive, omit_if(AIR_DENSITY)] = AIR_DENSITY
    """Density of air [kg/m^3]; omitted from files where it is the default."""
    task_seed: Index | None = None
    """Seed of the random load cases of load_cases = "ten-wrenches"."""
    module: Annotated[Module, Field(validate_default=True)] = Module()
    """Module of the platform."""
    module_types: Annotated[tuple[features.ModuleType, ...], OMIT_EMPTY] = ()
    """Types of module, if the platform has several, with as many modules of each as it counts."""
    end_effector: EndEffector = EndEffector()
    """End-effector."""
    load_cases: LoadCases
    """Wrenches that the rotors must produce."""
    exposure: Annotated[tuple[Exposure, ...], at_most(LIMITS.requirements)] = ()
    """Regions that airflow must stay out of, or inside."""
    search: Search = Search()
    """Options of the search."""
    flight: features.AskedFlight = features.AskedFlight()
    """Required capabilities beyond the load cases."""
    tolerances: features.Tolerances = features.Tolerances()
    """Build errors to survive, unless `flight.tolerances = false`."""
    goals: Annotated[features.Goals, omit_if(features.Goals())] = features.Goals()
    """Goals besides control effort; omitted from files if empty."""

    @field_validator("module")
    @classmethod
    def _derived_fields(cls, module: Module, info: ValidationInfo) -> Module:
        """Fill in `joint_mass` of a new task, and `max_thrust_to_weight` from `max_thrust` if gravity is valid."""
        if not module.rotor_table.count:
            refuse(("rotors", "must have at least one entry: only a type of module may have none"))
        fields, gravity, derived = module.model_fields_set, info.data.get("gravity"), dict[str, float]()
        if cls is Task and "joint_mass" not in fields:
            derived["joint_mass"] = features.joint_mass(module)
        module = module.replace(**derived) if derived else module
        return module if gravity is None else module.with_thrust_to_weight(gravity)

    @field_validator("module_types", mode="before")
    @classmethod
    def _sources(cls, types: Any, info: ValidationInfo) -> Any:
        """Fill in what types of a new task leave out; those of a resolved task have every field."""
        module, gravity = info.data.get("module"), info.data.get("gravity")
        return features.with_sources(types, module, gravity) if cls is Task and module and gravity else types

    @field_validator("module_types")
    @classmethod
    def _thrusts(cls, types: tuple[features.ModuleType, ...], info: ValidationInfo) -> Any:
        gravity = info.data.get("gravity")
        return types if gravity is None else tuple(kind.with_thrust_to_weight(gravity) for kind in types)

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, data: Any) -> Any:
        """Fill in the defaults of a new task; a resolved task has every field already."""
        return features.with_defaults(data) if cls is Task and isinstance(data, dict) else data

    @model_serializer(mode="wrap")
    def _write_every_field(self, write: SerializerFunctionWrapHandler) -> Any:
        """Return all fields of a new task that have a value: those that are left out have defaults of their own."""
        written = write(self)
        if type(self) is not Task:
            return written
        values = ((name, every_field(getattr(self, name), none=False)) for name in written)
        return {name: value for name, value in values if value is not None}

    def _broken_rules(self) -> Broken:
        if not self.sizes:
            yield "modules", f"`fewest <= most` must hold, but got {show(self.modules)}"
        if len(self.sizes) > LIMITS.sizes:
            yield "modules", f"must be at most {LIMITS.sizes} sizes, but got {show(self.modules)}"
        regions = [region for region in self.exposure if segment_of(region, 0) is not None]
        if (parts := sum(len(region.shapes) for region in regions)) > LIMITS.segments:
            kinds = {region.kind for region in regions}
            names = " and ".join(f"{name}s" for kind, name in PART_NAMES.items() if kind in kinds)
            yield "exposure", f"must have at most {LIMITS.segments} {names} in all, but got {parts:,}"
        shapes = (shape for region in self.exposure for shape in region.shapes)
        corners = sum(len(shape.corners) for shape in shapes)
        if corners > LIMITS.all_corners:
            yield "exposure", f"must have at most {LIMITS.all_corners:,} corners in all, but got {corners:,}"
        if self.load_cases != "ten-wrenches" and self.task_seed is not None:
            rule = 'must be left out unless load_cases = "ten-wrenches"'
            yield "task_seed", f"{rule}, but got {self.task_seed}"
        if self.load_cases == "ten-wrenches" and self.task_seed is None:
            yield "task_seed", 'must be given with load_cases = "ten-wrenches", but is missing'
        end_effector, position = self.end_effector, self.end_effector.fixed_position
        distance, minimum = math.hypot(*(position or ())), LEAST_OFFSET * self.module.arm_length
        if position is not None and distance < minimum:
            rule = f"takes its direction from p_E: `||end_effector.position|| >= {minimum:g}` must hold"
            numbers = [e for e, region in enumerate(self.exposure) if needs_offset(region)]
            yield from ((("exposure", e), f"{rule}, but got {show(end_effector.position)}") for e in numbers)
        farthest = self.farthest_end_effector(self.sizes[-1]) if self.sizes else math.inf
        if distance > farthest:
            field = ("end_effector", "position")
            yield field, f"`||position|| <= {farthest:g}` must hold, but got {show(end_effector.position)}"
        if end_effector.stand_off > farthest:
            field = ("end_effector", "stand_off")
            yield field, f"`stand_off <= {farthest:g}` must hold, but got {show(end_effector.stand_off)}"
        if self.sizes and self.load_cases != "ten-wrenches":
            n = self.sizes[-1]
            rotors = n * self.rotors_per_module
            units = self.force_unit(n), self.torque_unit(n)
            yield from broken_rules(self.load_cases, *units)
            if len(self.exposure) + len(objects(self.load_cases)) > LIMITS.requirements:
                yield "exposure", f"must have at most {LIMITS.requirements} entries, objects of `contact` included"
            corners = sum(1 + len(case.corners) for case in self.load_cases)
            flights = dict.fromkeys(self.at(level).flight for level in self.goals.levels)
            yield from dict.fromkeys(
                x for flight in flights for x in flight.broken_reserves(corners, rotors, *units)
            )
        if end_effector.axis == "force" and self.rod_axis is None:
            name = "axis" if end_effector.axis_case is None else "axis_case"
            rule = "must mean a load case with a force at the end-effector"
            yield ("end_effector", name), f"{rule}, but got {show(getattr(end_effector, name))}"
        yield from self._broken_thrust()
        yield from (broken for rule in features.TASK_RULES for broken in rule(self))

    def _broken_thrust(self) -> Broken:
        """Yield broken rules about limits of rotor inputs."""
        modules: list[tuple[tuple[str | int, ...], Module]] = [(("module",), self.module)]
        modules += [(("module_types", k), kind) for k, kind in enumerate(self.module_types)]
        for field, module in modules:
            due = module.thrust_coefficient * module.max_input(self.gravity)
            if module.max_thrust is not None and not math.isclose(module.max_thrust, due, rel_tol=PRECISION):
                rule = f"must agree with max_thrust_to_weight = {module.max_thrust_to_weight:g}"
                but = f"which is {due:.4g} N per rotor, but got {module.max_thrust}: leave one of them out"
                yield (*field, "max_thrust"), f"{rule}, {but}"
        module = self.module
        lowest = min((self.search.peak_input, *self.goals.peak_input))
        if module.min_input >= lowest:
            rule = f"must be less than the largest share that rotors may use, {lowest:g}"
            yield ("module", "min_input"), f"{rule}, but got {module.min_input}"

    @property
    def sizes(self) -> range:
        """All numbers of modules of the task."""
        fewest, most = self.modules if isinstance(self.modules, tuple) else (self.modules, self.modules)
        return range(fewest, most + 1)

    @property
    def n(self) -> int:
        """Number of modules of a task with a single size; ValueError for a range."""
        if isinstance(self.modules, tuple):
            raise ValueError(f"`modules` must be one number here, but got {list(self.modules)}")
        return self.modules

    @property
    def rotor_count(self) -> int:
        """n r: number of rotor inputs of a task with a single size; modules with fewer rotors have idle inputs."""
        return self.n * self.rotors_per_module

    @property
    def types(self) -> tuple[Module, ...]:
        """Types of module, or the module of a platform with one."""
        return self.module_types or (self.module,)

    @property
    def rotors_per_module(self) -> int:
        """r."""
        return max(kind.rotor_table.count for kind in self.types)

    @property
    def longest_connector(self) -> float:
        """Largest distance of a module's centre from its connectors [m]."""
        return max(kind.connector_distance for kind in self.types)

    def modules_mass(self, n: int) -> float:
        """Return the mass of n modules [kg]."""
        types = self.module_types
        return sum(kind.count * kind.mass for kind in types) if types else n * self.module.mass

    def total_mass(self, n: int) -> float:
        """m_t of a platform of n modules [kg]."""
        rod, joints = self.end_effector.counted_rod, n - 1 + (self.search.closures or 0)
        rod_mass = 0.0 if rod is None else rod.mass
        return self.modules_mass(n) + self.end_effector.mass + joints * self.module.joint_mass + rod_mass

    @property
    def cases(self) -> tuple[LoadCase, ...]:
        """Load cases, with random ones drawn."""
        return ten_wrenches(self.task_seed or 0) if self.load_cases == "ten-wrenches" else self.load_cases

    def force_unit(self, n: int) -> float:
        """m_t g of a platform of n modules [N]."""
        return self.total_mass(n) * self.gravity

    def torque_unit(self, n: int) -> float:
        """l_arm m_t g of a platform of n modules [N m]."""
        return self.module.arm_length * self.force_unit(n)

    def farthest_end_effector(self, n: int) -> float:
        """Return the largest allowed distance of p_E from the COM for n modules [m]."""
        return FARTHEST_TIP * 2 * n * (self.longest_connector + self.module.arm_length)

    def largest_reach(self, n: int) -> float | None:
        """Return the largest allowed distance of p_E from the connector of its rod for n modules [m]; None: any."""
        reach = self.end_effector.largest_reach
        if reach is not None:
            return reach or None
        packed, rod = room.LARGE * room.packed_width(self.longest_connector, n), self.end_effector
        # a fixed position may need a longer rod, which the audit notes
        limited = rod.rod == "straight" and rod.fixed_position is None
        return min(packed, self.stiff_length(n)) if limited else packed

    @property
    def rod_axis(self) -> Vector | None:
        """Unit vector from which the rod may deviate by `largest_angle_deg`; None: any direction."""
        axis, name = self.end_effector.axis, self.end_effector.axis_case
        if axis != "force":
            return axis and unit(axis)
        forces = (case.at_end_effector.force for case in self.cases if name in (None, case.name))
        return next((unit(force) for force in forces if any(force)), None)

    def longest_lever(self, n: int) -> float:
        """Return the largest distance of p_E from the COM in a clear design [m].

        Every connector is less than 2 n l_c from the COM.
        """
        position, reach = self.end_effector.fixed_position, self.largest_reach(n)
        lever = self.farthest_end_effector(n) if position is None else math.hypot(*position)
        if reach is not None:
            lever = min(lever, reach + 2 * n * self.longest_connector)
        return lever + TOLERANCE * self.module.arm_length

    def stiff_length(self, n: int) -> float:
        """Return the length of rod that bends by `rod_deflection` under the largest loads at its tip [m]."""
        units = self.force_unit(n), self.torque_unit(n)
        cases = (corner for case in self.cases for corner in (case, *case.corners))
        wrenches = [case.to_si(*units).at_end_effector for case in cases]
        force, torque = (max(math.hypot(*getattr(w, part)) for w in wrenches) for part in ("force", "torque"))
        return self.end_effector.stiff_length(force, torque, self.gravity)

    @property
    def max_thrust_to_weight(self) -> float:
        """Largest thrust of a module in a design, over its weight."""
        return self.search.peak_input * self.module.max_thrust_to_weight

    @property
    def max_input(self) -> float:
        """Largest squared rotor speed in a design, peak_input u_max [rad^2/s^2]."""
        return self.search.peak_input * self.module.max_input(self.gravity)

    @property
    def min_input(self) -> float:
        """Smallest squared rotor speed in a design [rad^2/s^2]."""
        return self.module.min_input * self.module.max_input(self.gravity)

    @property
    def min_thrust_to_weight(self) -> float:
        """Smallest thrust of a module in a design, over its weight."""
        return self.module.min_input * self.module.max_thrust_to_weight

    @property
    def tip_radius(self) -> float | None:
        """Radius of the ball around p_E that must stay out of airflow [m]; None if p_E may be in airflow."""
        is_excluded = self.body_clearance is not None and self.exclusion_radius is not None
        return self.end_effector.rod_radius if is_excluded else None

    @property
    def exclusion_radius(self) -> float | None:
        """d_E: minimum distance of p_E from every module's centre [m]; None if not required."""
        l_c = self.longest_connector if self.end_effector.exclusion else 0.0
        return max(l_c, self.end_effector.stand_off) or None

    @property
    def separation(self) -> float:
        """r_m: minimum distance of module centres in the ablation [m]."""
        return self.search.separation or 2 * max(kind.arm_length for kind in self.types)

    @property
    def body_clearance(self) -> float | None:
        """Minimum distance of centres of modules not bolted together [m]; None if not required."""
        clearance = self.search.body_clearance
        if clearance is False or self.search.interference == "separation":
            return None
        flying = (kind for kind in self.types if kind.rotor_table.count)
        return clearance or 2 * max(kind.arm_length + kind.body.rotor_radius for kind in flying)

    @property
    def centre_distance(self) -> float | None:
        """Solver's minimum distance of centres of modules not bolted together [m]; None without body clearance.

        `body_clearance`, or more if the balls around the modules' rigid parts need it: then no parts touch in any
        orientation. This is conservative by at most 2 rho - body_clearance, 0.67 mm by default. The audit requires
        `body_clearance`, and measures the parts themselves.
        """
        clearance = self.body_clearance
        return None if clearance is None else max(clearance, 2 * max(map(room.body_radius, self.types)))

    @property
    def parts_off_airflow(self) -> bool:
        """True if rotors, hubs and arms must stay out of other modules' airflow."""
        return self.body_clearance is not None or self.search.interference == "parts"

    def part_cover(self, module: Module) -> room.Balls:
        """Return the balls around a module's parts that the search keeps out of other airflow and solid regions.

        If airflows must neither merge nor enter a solid region, parts inside their own airflow need no balls.
        """
        air_enters = any(exposure.solid and not exposure.geometry for exposure in self.exposure)
        needs_all = air_enters or self.search.interference != "airflow"
        return room.whole_cover(module) if needs_all else room.part_cover(module)

    def folds(self, margin: float = 0.0) -> Folds:
        """Return the folds of hinges that the search allows, within +-pi/2, of any two types of module [rad].

        With body clearance rotors must not touch the neighbour, and all parts must stay out of its airflow.

        Args:
            margin: required clearance [m].
        """
        folds: Folds = ((-math.pi / 2, math.pi / 2),)
        if not self.parts_off_airflow:
            return folds
        for first, second in product(self.types, repeat=2):
            if self.body_clearance is not None:
                folds = intersect(folds, room.clear_folds(first, second, margin))
            folds = intersect(folds, room.airflow_folds(first, second, margin))
        return folds

    @property
    def joint_limits(self) -> tuple[float | None, float | None]:
        """Limits of the force [N] and moment [N m] in a joint; None: no limit."""
        flight, module = self.flight, self.module
        force = module.joint_force if flight.joint_force == "rated" else flight.joint_force
        return force, module.joint_moment if flight.joint_moment == "rated" else flight.joint_moment

    def at(self, level: features.Level) -> Task:
        """Return the task with its goals fixed at a level, without goals."""
        task = self.model_copy(update={"goals": features.Goals()})
        for goal, value in zip(features.GOALS.values(), level, strict=True):
            part, field = goal.field.split(".")
            if value is not None:
                for table in range(len(task.exposure)) if part == "exposure" else (part,):
                    task = task.with_fields(table, **{field: value})
        required = True if level.hinge_angle_deg else task.flight.tolerances
        task = task.with_fields("flight", tolerances=None if task.tolerances == features.Tolerances() else required)
        # without failures there is no torque after one
        return task.with_fields("flight", rotor_out_torque=None) if task.flight.rotor_out == "none" else task

    def with_fields(self, part: str | int, **fields: Any) -> Self:
        """Return the task with changed fields of a table, or of an exposure requirement by number, unvalidated."""
        if isinstance(part, str):
            return self.model_copy(update={part: getattr(self, part).model_copy(update=fields)})
        changed = self.exposure[part].model_copy(update=fields)
        return self.model_copy(update={"exposure": (*self.exposure[:part], changed, *self.exposure[part + 1 :])})

    _repr_html_ = features.task_html

    def resolve(self, n: int) -> ResolvedTask:
        """Return the task for n modules with every default filled in and its load cases in N and N m.

        The result has no goals: a design meets the fields that they set.
        """
        units = self.force_unit(n), self.torque_unit(n)
        grows = self.end_effector.rod_mass == "included" or self.search.lattice is not None
        lengths = {"separation": self.separation, "body_clearance": self.body_clearance or False}
        reach = {"largest_reach": self.largest_reach(n) or False}
        end_effector = ResolvedEndEffector(**{**dict(self.end_effector), **reach})
        fields = {
            **dict(self),
            "modules": n,
            "module": self.module.resolve(),
            "module_types": tuple(kind.resolve() for kind in self.module_types),
            "end_effector": end_effector,
            "exposure": (*self.exposure, *objects(self.cases)),
            "load_cases": tuple(case.to_si(*units, grows=grows) for case in self.cases),
            "task_seed": None,
            "search": self.search.model_copy(update=lengths),
            "flight": self.flight.to_si(*units, grows=grows, maximized=self.search.maximize is not None),
            "goals": features.Goals(),
        }
        return ResolvedTask(**fields)


class ResolvedTask(Task):
    """Self-contained task for one number of modules: every default filled in, load cases in SI.

    One attitude of the platform serves all wrenches.
    """

    modules: Count
    end_effector: ResolvedEndEffector = ResolvedEndEffector()
    load_cases: Annotated[tuple[LoadCase, ...], at_most(LIMITS.load_cases), NonEmpty]
    flight: Annotated[features.AskedFlight, omit_if(features.AskedFlight())] = features.AskedFlight()
    tolerances: Annotated[features.Tolerances, omit_if(features.Tolerances())] = features.Tolerances()
    types_of_nodes: Annotated[tuple[Index, ...], Field(exclude=True)] = ()
    """Number of each module's type in a tree (`on`); not in files, where designs have names."""

    @property
    def modules_of_nodes(self) -> tuple[Module, ...]:
        """Module at each node of the tree; ValueError if there are types of module, but no tree (`on`)."""
        if not self.module_types:
            return (self.module,) * self.n
        if not self.types_of_nodes:
            raise ValueError("a task with module_types needs a tree to say which type is where")
        return tuple(self.module_types[k] for k in self.types_of_nodes)

    @property
    def counts(self) -> tuple[tuple[Module, int], ...]:
        """Types of module, or the module of a platform with one, each with its number."""
        return tuple((kind, kind.count) for kind in self.module_types) or ((self.module, self.n),)

    @property
    def placed_types(self) -> tuple[tuple[Module, list[int]], ...]:
        """Types of module, or the module of a platform with one, each with its nodes; ValueError without a tree."""
        numbers = range(len(self.modules_of_nodes))
        if not self.module_types:
            return ((self.module, list(numbers)),)
        nodes = ([i for i in numbers if self.types_of_nodes[i] == k] for k in range(len(self.module_types)))
        return tuple(zip(self.module_types, nodes, strict=True))

    @property
    def number_of_rotors(self) -> int:
        """N: number of rotors of a platform, without those that a type of module lacks."""
        return sum(count * kind.rotor_table.count for kind, count in self.counts)

    def rotor_shares(self, kind: Module) -> Array:
        """Return the largest squared speeds of a type's rotors over u_max of [module], shape (r,)."""
        u_max = self.module.max_input(self.gravity)
        return kind.max_input(self.gravity) / u_max * kind.input_shares(self.gravity)

    @property
    def connector_distances(self) -> Array:
        """l_c of each module, shape (n,) [m]."""
        return np.array([module.connector_distance for module in self.modules_of_nodes])

    @property
    def input_shares(self) -> Array:
        """Largest squared speed of each rotor over u_max of [module], shape (n, r); 0 where a module has fewer."""
        shares = np.zeros((self.n, self.rotors_per_module))
        for kind, nodes in self.placed_types:
            shares[nodes, : kind.rotor_table.count] = self.rotor_shares(kind)
        return shares

    @property
    def input_limits(self) -> Array:
        """Largest squared speed of each rotor in a design, shape (n, r) [rad^2/s^2]."""
        return self.max_input * self.input_shares

    @property
    def attitude(self) -> str:
        """` without leaning` if several wrenches share the attitude; or empty."""
        wrenches = sum(1 + len(case.corners) for case in self.load_cases)
        return " without leaning" if wrenches > 1 or self.flight.asks else ""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        rule = 'must be "SI" in a design, but got "weight"'
        for k, case in enumerate(self.load_cases):
            if case.units == "weight":
                yield ("load_cases", k, "units"), rule
        if self.flight.asks and self.flight.units != "SI":
            yield ("flight", "units"), rule
        for k, case in enumerate(self.load_cases):
            if case.carries_weight:
                text = "must be false in a design, the weight being written out in `com`, but got true"
                yield ("load_cases", k, "carries_weight"), text
            if case.contact is not None:
                text = "must be left out in a design, the object being written out in `exposure`, but got"
                yield ("load_cases", k, "contact"), f"{text} {show(case.contact)}"

    def with_rod(self, rod: CountedRod | None) -> ResolvedTask:
        """Return the task for a platform whose rod counts, or None; loads in units of weight grow with it."""
        if rod == self.end_effector.counted_rod:
            return self
        return self._regrow(self.with_fields("end_effector", counted_rod=rod))

    def on(self, topology: Topology) -> ResolvedTask:
        """Return the task for a tree or a lattice: with its closures, and its types of module.

        Raises:
            ValueError: it has other numbers of modules of each type than the task.
        """
        types = topology.types
        if sorted(types) != [k for k, kind in enumerate(self.module_types) for _ in range(kind.count)]:
            counts = ", ".join(
                f"{kind.count} {kind.name} ({x})" for x, kind in zip(LETTERS, self.module_types, strict=False)
            )
            raise ValueError(f"must be of {counts or 'one type of module'}, but got {topology.key}")
        task = self.with_closures(len(topology.closures))
        return task if task.types_of_nodes == types else task.model_copy(update={"types_of_nodes": types})

    def with_closures(self, closures: int) -> ResolvedTask:
        """Return the task for a lattice with some joints beyond those of a tree; loads in units of weight grow."""
        if closures == (self.search.closures or 0):
            return self
        return self._regrow(self.with_fields("search", closures=closures or None))

    def _regrow(self, task: ResolvedTask) -> ResolvedTask:
        """Return a copy with another mass, and loads in units of weight that fit it."""
        before, after = self.force_unit(self.n), task.force_unit(self.n)
        cases = tuple(case.regrow(before, after) for case in self.load_cases)
        flight = self.flight.regrow(after / before, self.search.maximize)
        return task.model_copy(update={"load_cases": cases, "flight": flight})

    @property
    def lightest(self) -> ResolvedTask:
        """Task for the lightest platform, without a counted rod and closures: the basis of bounds and proofs."""
        return self.with_rod(None).with_closures(0)

    @property
    def heaviest_rod(self) -> float:
        """Largest mass of a counted rod in a clear design [kg]: it may be off by TOLERANCE of the total mass."""
        if self.end_effector.rod_mass == "ignored":
            return 0.0
        longest = (self.largest_reach(self.n) or 0.0) + TOLERANCE * self.module.arm_length
        heaviest = self.end_effector.rod_linear_density * longest
        return (heaviest + TOLERANCE * self.total_mass(self.n)) / (1 - TOLERANCE)

    @property
    def heaviest_closures(self) -> float:
        """Largest mass of the joints that close a lattice's cycles: n cells have at most 2 n - 2 sqrt(n) [kg]."""
        most = int((math.sqrt(self.n) - 1) ** 2 + 1e-9)
        return 0.0 if self.search.lattice is None else most * self.module.joint_mass

    @property
    def declared(self) -> ResolvedTask:
        """Task without expanded sets of wrenches, as in a design file."""
        return self

    @property
    def case_labels(self) -> tuple[str, ...]:
        """Labels of the load cases."""
        return labels(self.load_cases)

    @property
    def dead_rotors(self) -> tuple[int | None, ...]:
        """Number of the dead rotor in each load case, in module-major order; None: all rotors run."""
        return (None,) * len(self.load_cases)

    @property
    def accelerations(self) -> tuple[Vector, ...]:
        """Angular acceleration of the platform in each load case, besides its wrench [rad/s^2]; zero here."""
        return ((0.0, 0.0, 0.0),) * len(self.load_cases)
