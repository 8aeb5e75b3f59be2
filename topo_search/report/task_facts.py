"""The task as understood by the program: every number with its unit, every option in words."""

import math
from collections.abc import Callable, Iterator, Sequence

from topo_search.limits import vector
from topo_search.model import AnyExposure, LoadCase, Module, ResolvedTask, Task, Tolerances
from topo_search.model.folds import folds_text
from topo_search.model.kinds import is_zero
from topo_search.model.largest_value import AT_POINT, ability
from topo_search.model.proven import upper_text
from topo_search.report.wording import figures, length, modules, quantity

Facts = tuple[str, Sequence[tuple[str, str]]]
"""A group of facts: its title, then names and values."""


def facts(task: ResolvedTask, *larger: ResolvedTask) -> tuple[Facts, ...]:
    """Return everything that a task specifies except its load cases; `larger`: the same with more modules."""
    numbered = [
        (region, (f"requirement {e}" if region.contact is None else "object", requirement(region)))
        for e, region in enumerate(task.exposure)
    ]
    regions = [fact for exposure, fact in numbered if exposure.geometry and not exposure.sides]
    inside = [fact for exposure, fact in numbered if exposure.geometry and exposure.sides]
    platforms = [] if inside else [("regions", "none, only the platform's own modules")]
    speeds = [fact for exposure, fact in numbered if not exposure.geometry and exposure.speed is not None]
    solids = [fact for exposure, fact in numbered if exposure.solid and not exposure.geometry]
    return (
        ("platform", list(_platform(task, *larger))),
        *_modules(task),
        ("end-effector", list(_end_effector(task))),
        *([("must stay out of the airflow", regions or platforms)] if regions or platforms else []),
        *([("airflow must stay where", inside)] if inside else []),
        *([("air may enter, rigid parts may not", solids)] if solids else []),
        *([("air speed", speeds)] if speeds else []),
        *_flight(task),
        ("search", _search(task)),
        *_tolerances(task),
    )


def _platform(*tasks: ResolvedTask) -> Iterator[tuple[str, str]]:
    def each(value: Callable[[ResolvedTask, int], float]) -> str:
        return ", ".join(figures(value(task, task.n)) for task in tasks)

    numbers, gravity = ", ".join(str(task.n) for task in tasks), figures(tasks[0].gravity)
    types = ", ".join(f"{kind.count} {kind.name}" for kind in tasks[0].module_types)
    yield "size", f"{numbers} module{'s' * (numbers != '1')}{types and ': '}{types}"
    yield "mass m_t", f"{each(ResolvedTask.total_mass)} kg, with {_included_parts(tasks[0])}"
    if (joint_mass := tasks[0].module.joint_mass) and tasks[0].module_types:
        yield "mass of a joint", f"{figures(joint_mass)} kg, at its connector"
    yield "weight m_t g", f"{each(ResolvedTask.force_unit)} N, at g = {gravity} m/s²"
    if tasks[0].attitude:
        yield "attitude", "one for all wrenches: the platform does not lean into a load"
    yield "unit of torque l_arm m_t g", f"{each(ResolvedTask.torque_unit)} N m"


def _included_parts(task: ResolvedTask) -> str:
    """Return the masses besides those of modules; that of the rod depends on the design."""
    rod = "" if task.end_effector.rod_mass == "ignored" else " and the rod"
    if rod and task.end_effector.counted_rod is None:
        rod = "; each design adds its rod"
    return f"{'joints and ' * bool(task.module.joint_mass)}end-effector{rod}"


def _modules(task: ResolvedTask) -> Iterator[Facts]:
    """Yield the module and its airflow envelope, of each type that there is."""
    for kind in task.module_types:
        yield f"type {kind.name}: {modules(kind.count)}", list(_module(task, kind))
        if kind.rotor_table.count:
            yield f"airflow envelope of {kind.name}", list(_envelope(task, kind))
    if not task.module_types:
        yield "module", list(_module(task, task.module))
        yield "airflow envelope", list(_envelope(task, task.module))


def _module(task: ResolvedTask, module: Module) -> Iterator[tuple[str, str]]:
    u_max, hover = module.max_input(task.gravity), module.hover_input(task.gravity)
    k_f, k_tau, thrust_to_weight = module.thrust_coefficient, module.torque_coefficient, module.max_thrust_to_weight
    yield "mass m", f"{figures(module.mass)} kg"
    if (joint_mass := task.module.joint_mass) and not task.module_types:
        yield "mass of a joint", f"{figures(joint_mass)} kg, at its connector"
    if task.module_types and module.battery_Wh is not None:
        yield "battery", f"{figures(module.battery_Wh)} W h"
    if not module.rotor_table.count:
        yield "hub", f"{' × '.join(map(length, module.body.hub))}" if module.body.frame is None else "a mesh"
        yield "connector distance l_c", f"{figures(module.connector_distance)} m"
        yield "rotors", "none"
        return
    yield "arm length l_arm", f"{figures(module.arm_length)} m"
    yield "connector distance l_c", f"{figures(module.connector_distance)} m"
    yield "thrust coefficient k_f", f"{figures(k_f)} N s²"
    yield "torque coefficient k_tau", f"{figures(k_tau)} N m s², {figures(k_tau / k_f)} m times the thrust"
    largest = f"{figures(thrust_to_weight)} times the module's weight, {figures(k_f * u_max)} N per rotor"
    yield "largest thrust", largest
    yield "largest input u_max", f"{figures(u_max)} rad²/s² ({_speed(u_max)})"
    merit, C_T = module.figure_of_merit(task.air_density), module.propeller_coefficient(task.air_density)
    yield "figure of merit", f"{figures(merit, 3)}, with rotors of {length(module.body.rotor_radius)} radius"
    propeller = "of propellers: thrust / (rho (revolutions / s)² diameter⁴)"
    yield "thrust coefficient C_T", f"{figures(C_T, 3)}, {propeller}"
    if module.rotors is not None:
        tilt = math.degrees(module.rotor_table.tilt)
        yield "rotors", f"{module.rotor_table.count}, with axes up to {figures(tilt, 3)}° from the module's"
        if not module.rotor_table.is_uniform:
            thrusts = k_f * module.rotor_table.gains * module.max_inputs(task.gravity)
            text = ", ".join(f"{figures(thrust, 3)} N" for thrust in thrusts.tolist())
            yield "largest thrusts of the rotors", text
            yield "control effort", "of squared inputs, which is then not that of squared thrusts"
    kept = "" if 0.9 <= module.jet_momentum <= 1.1 else "; a jet that keeps its momentum has 0.9 to 1.1"
    jet = f"{figures(module.jet_momentum, 3)} of the thrust far below, by airflow.jet{kept}"
    yield "momentum of the jet", jet if module.rotor_table.is_x else f"{jet}; it was measured for an X"
    tips = (figures(module.tip_speed(u), 3) for u in (hover, u_max))
    yield "rotor tip speed", "{} m/s at hover, {} m/s at full thrust".format(*tips)
    if task.module.min_input:
        yield "smallest input", f"{figures(task.module.min_input)} u_max"
    yield "input at hover", f"{figures(hover)} rad²/s² ({_speed(hover)})"


def _envelope(task: ResolvedTask, module: Module) -> Iterator[tuple[str, str]]:
    envelope, rotors = module.envelopes[0], module.rotor_table
    if tilt := math.degrees(rotors.tilt):
        whose = "each rotor has its own, along its axis" if rotors.has_own_jets else "one for all"
        yield "envelopes of a module", f"axes of rotors are up to {figures(tilt, 3)}° from the module's: {whose}"
    yield f"radius at the {'rotor' if rotors.has_own_jets else 'module'}", f"{figures(envelope.start_radius)} m"
    yield "radius at the far end", f"{figures(envelope.end_radius)} m"
    yield "length of the axis", f"{figures(envelope.length)} m"
    airflow = module.airflow
    spread = airflow.spread_angle_deg if rotors.has_own_jets else module.spread_deg(airflow.spread_angle_deg)
    yield "full spreading angle", f"{figures(spread)}°"
    if task.exposure and (regions := module.region_airflow) is not None:
        own, of_all = regions.spread_angle_deg, module.spread_deg(regions.spread_angle_deg)
        angle = figures(own if rotors.has_own_jets else of_all)
        sizes = f"{length(regions.start_radius)} at the module, full angle {angle}°"
        yield "envelope against regions", f"{sizes}, ending {length(regions.reach)} below"


def _end_effector(task: ResolvedTask) -> Iterator[tuple[str, str]]:
    tip, apart, reach = task.end_effector, task.exclusion_radius, task.largest_reach(task.n)
    fixed = tip.fixed_position
    yield "mass m_E", f"{figures(tip.mass)} kg"
    position = "free, chosen by the search" if fixed is None else f"{vector(fixed)} m"
    yield "position p_E from the centre of mass", position
    yield "distance from module centres", "any" if apart is None else f"at least {figures(apart)} m"
    yield "radius of the rod", length(tip.rod_radius)
    required = "required, clear of all parts and airflow"
    yield "straight rod", "reported, not required" if tip.rod == "none" else required
    if reach is not None:
        yield "reach from the rod's connector", f"at most {length(reach)}"
    if (axis := task.rod_axis) is not None:
        along = f"{vector(axis)}, along the force" if tip.axis == "force" else vector(axis)
        yield "rod, from its connector", f"within {figures(tip.largest_angle_deg)}° of {along}"


def goals(task: Task) -> Facts:
    """Return the goals that are traded off against control effort."""
    task_goals = task.goals
    force, torque = ("m_t g", "l_arm m_t g") if task.flight.units == "weight" else ("N", "N m")
    levels = (
        ("clearances", [length(x) for x in task_goals.clearance]),
        ("stand-off of the end-effector", [length(x) for x in task_goals.stand_off]),
        ("largest rotor input", [f"{figures(x)} u_max" for x in task_goals.peak_input]),
        ("force reserve", [f"{x:g} {force}" for x in task_goals.force_reserve]),
        ("torque reserve", [f"{x:g} {torque}" for x in task_goals.torque_reserve]),
        ("any one rotor failure survived in", list(task_goals.rotor_out)),
        ("largest moment in a joint", [f"{x:g} N m" for x in task_goals.joint_moment]),
        ("hinge tolerance", [f"{x:g}°" for x in task_goals.hinge_angle_deg]),
        ("air speed in all regions", [f"{x:g} m/s" for x in task_goals.speed]),
        ("modules", [str(n) for n in task.sizes] if task_goals.modules else []),
    )
    rows = [(name, ", ".join(texts)) for name, texts in levels if texts]
    return ("goals besides control effort", (*rows, ("searches", quantity(len(task_goals.levels), "level"))))


def requirement(exposure: AnyExposure) -> str:
    """Return one exposure requirement in words."""
    words, solid, there = exposure.words, "; solid: rotors, arms and rod stay out too", "there"
    if exposure.sides and exposure.geometry:
        words, solid, there = exposure.sides, "; solid: rotors, arms and rod too", "elsewhere"
    words += solid * (exposure.solid and exposure.geometry)
    if exposure.speed is None:
        return words
    reach = "" if exposure.speed_reach is None else f" within {length(exposure.speed_reach)} of the end-effector"
    return f"{words}; air {there} at most {figures(exposure.speed)} m/s{reach}"


def load_cases(task: ResolvedTask) -> list[list[str]]:
    """Return a row for each load case: number and name, wrenches in SI and relative units, weight."""
    force_unit, torque_unit = task.force_unit(task.n), task.torque_unit(task.n)
    free = "0: required, but adds no control effort"
    names = (f"{k} ({case.name})" if case.name else str(k) for k, case in enumerate(task.load_cases))
    wrenches = ("; ".join(_wrenches(case, force_unit, torque_unit)) for case in task.load_cases)
    weights = (figures(case.weight) if case.weight else free for case in task.load_cases)
    return [list(row) for row in zip(names, wrenches, weights, strict=True)]


def _wrenches(case: LoadCase, force_unit: float, torque_unit: float) -> list[str]:
    texts = []
    for where, wrench in (("at the end-effector", case.at_end_effector), ("at the centre of mass", case.at_com)):
        for name, value, unit, scale, scaled in (
            ("force", wrench.force, "N", force_unit, "m_t g"),
            ("torque", wrench.torque, "N m", torque_unit, "l_arm m_t g"),
        ):
            if not is_zero(value):
                relative = tuple(x / scale for x in value)
                texts.append(f"{name} {where} {vector(value)} {unit} = {vector(relative)} {scaled}")
    return [*(texts or ["nothing"]), *_wrench_sets(case)]


def _wrench_sets(case: LoadCase) -> Iterator[str]:
    """Yield the sets of wrenches that must be feasible in addition."""
    corners = f"{quantity(len(case.corners), 'corner')}, which suffice"
    if case.cone is not None:
        yield (
            f"in addition, at the end-effector any force up to {figures(case.cone.force)} N within "
            f"{figures(case.cone.half_angle_deg)}° of {vector(case.cone.axis)}: {corners}"
        )
    if case.vertices:
        hull = "; ".join(f"force {vector(w.force)} N, torque {vector(w.torque)} N m" for w in case.vertices)
        yield f"in addition, at the end-effector all wrenches between its own and {hull}: {corners}"


def _search(task: ResolvedTask) -> tuple[tuple[str, str], ...]:
    search = task.search
    rule = {
        "airflow": "airflow envelopes must not overlap",
        "parts": "airflow envelopes may overlap; rotors, hubs and arms stay out of other modules' envelopes",
        "separation": f"centres at least {figures(task.separation)} m apart, instead of airflow (ablation)",
    }[search.interference]
    body, search_distance, folds = task.body_clearance, task.centre_distance, task.folds(search.margin)
    hinges = folds_text(folds, "°") if folds else "none: rotors would touch a neighbour or its airflow at any angle"
    if search.hinge_step_deg is not None:
        hinges += f", in steps of {figures(search.hinge_step_deg)}°"
    if search.hinge_angles_deg is not None:
        hinges += f", only ±{', ±'.join(map(figures, sorted(search.hinge_angles_deg)))}°"
    if search.lattice is not None:
        hinges = "0: a flat lattice, in which all neighbours are bolted together"
    centres = "any" if body is None else f"centres at least {figures(body)} m apart"
    if body is not None and search_distance is not None and search_distance > body:
        centres += f"; the search keeps {upper_text(search_distance, 4)} m, so that no parts can touch"
    root = "any orientation" if search.root == "free" else "two angles of at most 90°, as in the paper"
    if search.root_orientation_deg is not None:
        psi, alpha_0, alpha_1 = map(figures, search.root_orientation_deg)
        root = f"psi = {psi}°, alpha_0 = {alpha_0}°, alpha_1 = {alpha_1}°"
    return (
        *([] if search.maximize is None else [("the best platform", f"{ability(task)}, as much as possible")]),
        ("root module", root),
        ("connectors", "aligned" if search.connectors == "aligned" else "any port to any port"),
        ("margin of every clearance", length(search.margin)),
        *([] if search.peak_input == 1 else [("rotor inputs", f"at most {figures(search.peak_input)} u_max")]),
        ("interference", rule),
        ("distance between unconnected modules", centres),
        ("hinge angles", hinges),
    )


def _flight(task: ResolvedTask) -> Iterator[Facts]:
    """Yield the required flight capabilities beyond the load cases, if there are any."""
    flight = task.flight
    if flight.asks:
        around = "hover" if flight.around == "hover" else "hover and every load case that carries the weight"
        which = "any horizontal force" if flight.directions == "horizontal" else "any force"
        weights = flight.force_reserve / task.force_unit(task.n), flight.torque_reserve / task.torque_unit(task.n)
        rows = [("around", around)] if flight.keeps_reserves else []
        if flight.force_reserve:
            size = f"{figures(flight.force_reserve)} N = {figures(weights[0], 3)} m_t g"
            rows.append(("force reserve", f"{which} of {size} at the {AT_POINT[flight.at]}"))
        if flight.torque_reserve:
            rows.append(("torque reserve", f"any of {figures(flight.torque_reserve)} N m"))
        if flight.tilt_deg:
            rows.append(("tilt", f"hover held at any tilt up to {figures(flight.tilt_deg)}°"))
        if any(flight.angular_acceleration):
            sizes = ", ".join(figures(a) for a in flight.angular_acceleration)
            rows.append(("angular acceleration", f"{sizes} rad/s² about x, y and z"))
        if flight.com_error:
            error = f"off by up to {figures(1e3 * flight.com_error)} mm along each axis"
            rows.append(("centre of mass, for all of the above", error))
        if flight.allocator == "pseudo-inverse":
            rows.append(("inputs for the above", "from the pseudo-inverse, without desaturation"))
        if flight.rotor_out != "none":
            in_hover = "hover" + " and every load case that carries the weight" * (flight.rotor_out == "all")
            torque = f", any torque of {figures(flight.rotor_out_torque or 0.0)} N m to spare"
            rows.append(("with any one rotor dead", in_hover + torque * bool(flight.rotor_out_torque)))
        for what, limit, unit in zip(("force", "moment"), task.joint_limits, ("N", "N m"), strict=True):
            if limit is not None:
                rows.append((f"{what} in a joint", f"at most {figures(limit)} {unit} in every load case"))
        if rows:
            yield "required beyond the load cases", rows


def _tolerances(task: ResolvedTask) -> Iterator[Facts]:
    """Yield the build tolerances, if the task states any."""
    built = task.tolerances
    if built != Tolerances():
        rows = (
            ("hinge angles", f"within {figures(built.hinge_angle_deg)}°"),
            ("module centres and end-effector", f"within {length(built.position)}"),
            ("airflow beyond its envelope", f"up to {length(built.envelope)}"),
        )
        role = "that clearances must survive" if task.flight.tolerances else "that are measured, not required"
        yield f"tolerances {role}", rows


def _speed(u: float) -> str:
    omega = math.sqrt(u)
    return f"{omega:.0f} rad/s, {60 * omega / math.tau:.0f} rpm"
