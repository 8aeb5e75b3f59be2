"""The task: modules, end-effector, load cases, exposure requirements and what the search may do.

| symbol | meaning | unit |
|---|---|---|
| n, K | modules, load cases | |
| m_E, m_t | end-effector mass; total mass n m + m_E | kg |
| p_E | end-effector position from the platform COM | m |
| W | task frame: axes of all vectors below | |
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from topo_search.model.exposure import Exposure, needs_offset
from topo_search.model.load_case import LoadCase, ten_wrenches
from topo_search.model.module import Module
from topo_search.model.value import Count, Positive, Value, Vector


class EndEffector(Value):
    """The rigid end-effector."""

    mass: Annotated[float, Field(strict=True, ge=0)] = 0.048
    """m_E [kg]."""
    position: Literal["free", "com"] | Vector = "free"
    """`free`: optimised; `com`: at the centre of mass; [x, y, z]: fixed, from the COM [m]."""
    exclusion: bool = True
    """Whether p_E stays at least connector_distance away from every module's centre."""

    @property
    def fixed_position(self) -> Vector | None:
        """p_E [m] if the task fixes it."""
        if self.position == "free":
            return None
        return (0.0, 0.0, 0.0) if self.position == "com" else self.position


class Search(Value):
    """What the search may do, and what it asks of the solver."""

    root: Literal["free", "paper"] = "free"
    """`free`: any root orientation; `paper`: psi = 0 and both angles within +-90 deg."""
    connectors: Literal["aligned", "any"] = "aligned"
    """`aligned`: parent port a meets child port a + 2; `any`: any port of the child."""
    margin: Annotated[float, Field(strict=True, ge=0)] = 1.0e-4
    """Asked of the solver beyond zero for every geometric clearance [m]."""
    interference: Literal["airflow", "separation"] = "airflow"
    """`separation`: the paper's ablation, a minimum distance in place of envelope clearance."""
    separation: Positive | None = None
    """Minimum distance of module centres in the ablation [m]; default: 2 arm_length."""
    body_clearance: Positive | Literal[False] | None = None
    """Least distance of centres not bolted together [m]; default: 2 (arm_length + rotor_radius); or false."""

    @model_validator(mode="after")
    def _no_body_clearance_in_the_ablation(self) -> Self:
        if self.interference == "separation" and self.body_clearance:
            raise ValueError(
                '`body_clearance` must be false (or left out) with interference = "separation", '
                f"but got {self.body_clearance}"
            )
        return self


def _sizes(value: Any) -> Any:
    """Read `5` and `[4, 6]`; say what a size is when it is neither."""
    if isinstance(value, (list, tuple)):
        if len(value) != 2:
            raise ValueError("must be one number of modules, or [fewest, most]")
        return tuple(value)
    return value


def _load_cases(value: Any) -> Any:
    """Tell a named family from a list of cases."""
    if isinstance(value, str) and value != "ten-wrenches":
        raise ValueError('must be a list of load cases or "ten-wrenches"')
    if isinstance(value, (list, tuple)) and not value:
        raise ValueError("must have at least one load case")
    return value


Sizes = Annotated[Count | tuple[Count, Count], BeforeValidator(_sizes)]
LoadCases = Annotated[Literal["ten-wrenches"] | tuple[LoadCase, ...], BeforeValidator(_load_cases)]


class Task(Value):
    """A task as a user states it; `resolve` writes every default out for one number of modules."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    """Letters, digits, dots, dashes and underscores; names the run folder."""
    modules: Sizes
    """n, or [fewest, most]."""
    gravity: Positive = 9.81
    """g [m/s^2]."""
    task_seed: Annotated[int, Field(strict=True, ge=0)] | None = None
    """Seed of the random family; belongs to load_cases = "ten-wrenches"."""
    module: Module = Module()
    """The module that the platform is made of."""
    end_effector: EndEffector = EndEffector()
    """The rigid end-effector."""
    load_cases: LoadCases
    """The wrenches that the rotors must produce."""
    exposure: tuple[Exposure, ...] = ()
    """Regions that must stay out of the airflow."""
    search: Search = Search()
    """What the search may do."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        lo, hi = self.sizes[0], self.sizes[-1]
        if lo > hi:
            raise ValueError(f"`modules[0] <= modules[1]` must hold, but got [{lo}, {hi}]")
        if (self.load_cases == "ten-wrenches") != (self.task_seed is not None):
            raise ValueError('`task_seed` belongs to load_cases = "ten-wrenches": give both or neither')
        if self.end_effector.fixed_position == (0.0, 0.0, 0.0):
            for number, requirement in enumerate(self.exposure):
                if needs_offset(requirement):
                    raise ValueError(
                        f"exposure[{number}] takes its direction from p_E, which end_effector.position puts at "
                        "the centre of mass, where it has none"
                    )
        return self

    @property
    def sizes(self) -> range:
        """Every number of modules that the task asks for."""
        if isinstance(self.modules, tuple):
            return range(self.modules[0], self.modules[1] + 1)
        return range(self.modules, self.modules + 1)

    @property
    def n(self) -> int:
        """The number of modules of a task with a single size; ValueError for a range."""
        if isinstance(self.modules, tuple):
            raise ValueError(f"the task has a range of sizes, {list(self.modules)}: resolve one of them first")
        return self.modules

    def total_mass(self, n: int) -> float:
        """m_t of a platform of n modules [kg]."""
        return n * self.module.mass + self.end_effector.mass

    def force_unit(self, n: int) -> float:
        """m_t g of a platform of n modules [N]."""
        return self.total_mass(n) * self.gravity

    def torque_unit(self, n: int) -> float:
        """l_arm m_t g of a platform of n modules [N m]."""
        return self.module.arm_length * self.force_unit(n)

    @property
    def separation(self) -> float:
        """r_m: least distance of module centres in the ablation [m]."""
        return self.search.separation or 2 * self.module.arm_length

    @property
    def body_clearance(self) -> float | None:
        """Least distance of module centres not bolted together [m]; None when it is not asked for."""
        given = self.search.body_clearance
        if given is False or self.search.interference == "separation":
            return None
        return given or 2 * (self.module.arm_length + self.module.body.rotor_radius)

    def resolve(self, n: int) -> ResolvedTask:
        """Return the task for n modules with every default filled in and its load cases in N and N m."""
        cases = ten_wrenches(self.task_seed or 0) if self.load_cases == "ten-wrenches" else self.load_cases
        units = self.force_unit(n), self.torque_unit(n)
        search = self.search.model_copy(
            update={"separation": self.separation, "body_clearance": self.body_clearance or False}
        )
        return ResolvedTask(
            **{
                **dict(self),
                "modules": n,
                "module": self.module.resolve(),
                "load_cases": tuple(case.to_si(*units) for case in cases),
                "task_seed": None,
                "search": search,
            }
        )


class ResolvedTask(Task):
    """A task for one number of modules that stands alone: no default is left open, load cases are in SI."""

    modules: Count
    load_cases: Annotated[tuple[LoadCase, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _in_si(self) -> Self:
        for number, case in enumerate(self.load_cases):
            if case.units != "SI":
                raise ValueError(f'load_cases[{number}].units must be "SI" in a design, but got "{case.units}"')
        return self
