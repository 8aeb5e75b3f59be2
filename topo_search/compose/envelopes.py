"""Airflow envelopes that tasks state by an air speed, as cone-spheres."""

from __future__ import annotations

from topo_search.model import BadInput, Fault, Module, Task
from topo_search.model.air import SpeedEnvelope
from topo_search.model.module import RegionAirflow, Thrust
from topo_search.model.proven import lower_text, upper_text
from verify.air import Unreached, enclose


def enclose_speed(task: Task) -> Task:
    """Return a task whose `module.airflow.speed` is replaced by its cone-sphere, in `module.airflow.regions`.

    Raises:
        BadInput: no air of one module is as fast, or the thrust at which it should be is beyond the rotors.
    """
    module, flow = task.module, task.module.airflow
    if flow.speed is None:
        return task
    found = envelope_of_speed(module, task.air_density, task.gravity, flow.speed, flow.at, source=task.name)
    regions = RegionAirflow(
        start_radius=found.start_radius_m, spread_angle_deg=found.spread_angle_deg, reach=found.reach_m
    )
    airflow = flow.model_copy(update={"speed": None, "at": "hover", "regions": regions})
    return task.model_copy(update={"module": module.model_copy(update={"airflow": airflow})})


def envelope_of_speed(
    module: Module, density: float, gravity: float, speed: float, at: Thrust, *, source: str
) -> SpeedEnvelope:
    """Return the cone-sphere of an air speed.

    Args:
        module: one module alone.
        density: rho [kg/m^3].
        gravity: g [m/s^2].
        speed: [m/s].
        at: the module's thrust.
        source: name of what states them.

    Raises:
        BadInput: see `enclose_speed`.
    """
    ratio = module.thrust_over_weight(at)
    if ratio > module.max_thrust_to_weight:
        rule = f"must be at most {module.max_thrust_to_weight:g} times the module's weight, but got {ratio:g}"
        raise BadInput(source, [Fault("module.airflow.at", rule)])
    thrust = ratio * module.mass * gravity
    where = f"{ratio:.4g} times the weight of a module, {thrust:.4g} N"
    try:
        return enclose(module, density, thrust, speed)
    except Unreached as error:
        most = f"{lower_text(error.bound.found, 4)} m/s (proven: at most {upper_text(error.bound.at_most, 4)})"
        rule = f"must be a speed that is reached; at {where}, that is up to {most}, but got {speed:g}"
    except ArithmeticError as error:
        rule = str(error)
    raise BadInput(source, [Fault("module.airflow.speed", rule)])
