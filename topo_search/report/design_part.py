"""Tables and sentences of the page of a design: joints, rod, clearances, residuals, inputs, reserves, power."""

import math
from collections.abc import Callable
from itertools import product

import numpy as np

from topo_search.export.audits import flight_lines
from topo_search.export.poses import axis_words, kind_of, throttles, thrusts
from topo_search.limits import vector
from topo_search.model import Audit, CaseFlight, Clearance, Design, Flight, Limit, Status, Vector
from topo_search.model.air import AirSpeeds
from topo_search.model.flight import direction
from topo_search.model.proven import at_least, at_most, lower_text, upper_text
from topo_search.model.stated import StatedCheck
from topo_search.model.topology import PORT_NAMES
from topo_search.report import Table
from topo_search.report.wording import clearance, figures, length, quantity, rounded_down, rounded_up, sentence


def joints(design: Design) -> Table:
    """Return the joints in an order of assembly: each module is bolted to one that is already in place."""
    names = [f"{i}{kind_of(design, i).name and f' ({kind_of(design, i).name})'}" for i in range(design.topology.n)]
    rows = [
        [
            names[i],
            f"{PORT_NAMES[b]} ({b})",
            names[h],
            f"{PORT_NAMES[a]} ({a})",
            f"{figures(math.degrees(alpha), 5)}°",
        ]
        for (h, a, i, b), alpha in design.bolts
    ]
    return Table(("module", "port", "bolted to module", "at port", "hinge angle"), rows, {0, 2, 4})


def rod(design: Design, audit: Audit) -> str | None:
    """Describe the rod that holds, or could hold, the end-effector, from the audit; None if it has no rod."""
    sheet, required = audit.assembly.end_effector, design.task.end_effector.rod != "none"
    if sheet is None:
        return None
    note = "" if sheet.note is None else f" Note: {sheet.note}."
    if sheet.mount is None or sheet.rod is None:
        return note.strip() or None
    tilt = axis_words(design.task, sheet.rod.direction)
    holds = "The end-effector sits on" if required else "The task has no rod; the end-effector could sit on"
    return (
        f"{holds} a straight rod of {length(sheet.rod.length_m)}, "
        f"{length(2 * sheet.rod.radius_m)} thick, {figures(1000 * sheet.rod.mass_kg, 3)} g, "
        f"from port {PORT_NAMES[sheet.mount.port]} of module "
        f"{sheet.mount.module}, along {vector(sheet.rod.direction_in_module)} in the axes of that module"
        f"{tilt and ', '}{tilt}.{note}"
    )


def nearest(pairs: tuple[Clearance, ...]) -> Table:
    """Return the pairs that are not clear, the worst first, then the nearest clear pairs."""
    nearest_first = sorted(pairs, key=lambda pair: pair.analytic_m)
    wrong = [pair for pair in nearest_first if pair.status != Status.CLEAR]
    clear = [pair for pair in nearest_first if pair.status == Status.CLEAR]
    rows = [
        {
            "between": pair.name,
            "audit": str(pair.status),
            "closed form": clearance(pair),
            "proven at least": "" if pair.lower_m is None else length(at_least(pair.lower_m, 3)),
            "proven at most": "" if pair.upper_m is None else length(at_most(pair.upper_m, 3)),
        }
        for pair in (*wrong[:200], *clear[:8])
    ]
    return Table.from_rows(rows, {2, 3, 4})


def findings(design: Design, audit: Audit) -> tuple[str, ...]:
    """Return sentences on overlapping airflow, placement, build tolerances, and the cost of a shorter rod."""
    sentences = []
    if (overlaps := audit.interference) is not None and overlaps.colliding_pairs:
        sizes = ", ".join(str(len(cluster)) for cluster in overlaps.clusters)
        sentences.append(
            f"{quantity(overlaps.colliding_pairs, 'pair')} of airflow envelopes overlap, in clusters of {sizes} "
            f"modules; the deepest overlap is {figures(at_most(overlaps.deepest_percent, 3), 3)} % of the largest "
            "possible."
        )
    shorter = design.shorter_rod if audit.verdict == "clear" else None
    placed = () if audit.placement is None else audit.placement.sentences()
    return *sentences, *(sentence(words) for words in (*placed, audit.tolerances_words, shorter) if words)


def errors(audit: Audit) -> Table | None:
    """Return the largest tolerated error of each kind, and the pair that a larger error violates first."""
    sensitivity = audit.sensitivity
    if sensitivity is None:
        return None
    kinds: tuple[tuple[str, Limit | None, Callable[[float], str]], ...] = (
        ("every hinge angle off by", sensitivity.hinge_angle_deg, lambda degrees: f"{figures(degrees, 3)}°"),
        ("module centres and end-effector off by", sensitivity.position_m, length),
        ("airflow reaching farther by", sensitivity.envelope_m, length),
    )
    rows = [
        {
            "error": name,
            "proven harmless up to": text(at_least(limit.tolerated, 3)),
            "violation found at": "" if limit.violated_at is None else text(at_most(limit.violated_at, 3)),
            "first violation": limit.name,
        }
        for name, limit, text in kinds
        if limit is not None
    ]
    return Table.from_rows(rows, {1, 2}) if rows else None


def residuals(audit: Audit) -> Table:
    """Return every number that the audit checked against a tolerance."""
    rows = [
        [
            row.words,
            str(row.status),
            rounded_up(row.value, f" {row.unit}"),
            rounded_up(row.scaled, digits=2),
            rounded_down(row.tolerance, digits=2),
        ]
        for row in audit.residuals
    ]
    return Table(("number", "audit", "off by", "relative error", "tolerance"), rows, {2, 3, 4})


def user_constraints(design: Design, audit: Audit | None) -> Table | None:
    """Return the values of the user's own constraints; "not checked" without an audit."""
    checks = [StatedCheck(**constraint.model_dump(), status="not checked") for constraint in design.stated]
    rows = [
        [constraint.name, constraint.version or "none", constraint.bounds, constraint.words]
        for constraint in (checks if audit is None else audit.stated)
    ]
    return Table(("constraint", "version", "bounds", "result"), rows) if rows else None


def loads(design: Design) -> Table:
    """Return the smallest and largest input of every load case, and its share of the control effort."""
    shares, lifts = throttles(design), thrusts(design)
    rows = []
    for k, (u, case) in enumerate(zip(design.inputs, design.task.load_cases, strict=True)):
        effort = case.weight * float(np.sum(u * u))
        share = effort / design.objective if design.objective else 0.0
        row = {
            "load case": f"{k} ({case.name})" if case.name else str(k),
            "smallest input": f"{lower_text(float(shares[k].min()), 4)} u_max",
            "largest input": f"{upper_text(float(shares[k].max()), 4)} u_max",
            "thrust of all rotors": f"{figures(float(lifts[k].sum()))} N",
            "share of J": f"{100 * share:.1f} %",
        }
        rows.append(row)
    return Table.from_rows(rows, range(5))


def flight_sentences(flight: Flight) -> list[str]:
    """Return sentences on the capabilities of the design beyond its task, the weakest point first."""
    return [*map(sentence, flight_lines(flight))]


def power(audit: Audit) -> Table | None:
    """Return the power of all rotors in hover and in each load case."""
    rows = [
        {
            "case": case.name,
            "at the shafts": f"{figures(case.shaft_W, 3)} W",
            "with ideal rotors": f"{figures(case.ideal_W, 3)} W",
            "figure of merit": figures(case.figure_of_merit, 3),
            "endurance at most": "" if (most := case.endurance_min) is None else f"{upper_text(most, 3)} min",
        }
        for case in audit.power
    ]
    return Table.from_rows(rows, {1, 2, 3, 4}) if rows else None


def air(air: AirSpeeds) -> Table:
    """Return the air speeds at the tip and in the regions, and the thrust loss, in each load case."""
    rows = []
    for case in air.cases:
        loss = max((rotor.thrust_loss for rotor in case.rotors), default=0.0)
        row = {"load case": case.name, "at the tip": f"{upper_text(case.tip_m_s, 3)} m/s"}
        row |= {
            f"{region.name}, at most": f"{upper_text(region.speed_at_most_m_s, 3)} m/s" for region in case.regions
        }
        rows.append(row | {"largest thrust loss of a rotor": f"{upper_text(100 * loss, 3)} %"})
    return Table.from_rows(rows, range(1, len(rows[0])))


def cases(flight: Flight) -> Table:
    """Return the reserves in hover and in each load case, with the weakest directions."""
    towards, about = "weakest towards", "weakest about"
    reserve_columns = (
        "force at the tip, any direction",
        towards,
        "side force at the tip",
        towards,
        "torque, any axis",
        about,
    )
    columns = ("case", "possible", *reserve_columns, "load factor", "inputs / u_max", "inputs at a limit")
    return Table(columns, [_case(case) for case in flight.cases], {2, 4, 6, 8, 9, 10})


def allocators(flight: Flight) -> Table | None:
    """Return two rows per case, for optimal inputs and for the pseudo-inverse; None for older files."""
    reserves = {
        "force at the tip, any direction": ("force_reserve_N", " N"),
        "force at the centre of mass, any direction": ("force_reserve_com_N", " N"),
        "side force at the tip": ("horizontal_reserve_N", " N"),
        "side force at the centre of mass": ("horizontal_reserve_com_N", " N"),
        "torque, any axis": ("torque_reserve_Nm", " N m"),
        "tilt": ("tilt_deg", "°"),
    }
    rows = []
    complete_cases = [case for case in flight.cases if case.force_reserve_com_N is not None]
    for case, (inputs, suffix) in product(complete_cases, (("optimal", ""), ("pseudo-inverse", "_pseudo_inverse"))):
        row = {"case": case.name, "inputs": inputs}
        row |= {title: rounded_down(getattr(case, name + suffix), unit) for title, (name, unit) in reserves.items()}
        accelerations = getattr(case, f"angular_acceleration_rad_s2{suffix}") or ()
        row["angular acceleration about x, y, z"] = ", ".join(map(rounded_down, accelerations))
        rows.append(row | {"centre of mass off by": rounded_down(getattr(case, f"com_error_m{suffix}"), " m")})
    return Table.from_rows(rows, range(2, 10)) if rows else None


def reserves(flight: Flight) -> Table:
    """Return the reserves without directions, for cards of designs side by side."""
    chosen = (0, 2, 4, 6, 8)
    full = cases(flight)
    rows = [[row[column] for column in chosen] for row in full.rows]
    return Table(tuple(full.columns[column] for column in chosen), rows, {1, 2, 3, 4})


def _case(case: CaseFlight) -> list[str]:
    inputs = ""
    if case.least_input is not None and case.largest_input is not None:
        inputs = f"{lower_text(case.least_input, 3)} to {upper_text(case.largest_input, 3)}"
    return [
        case.name,
        {True: "yes", False: "no", None: "undecided"}[case.possible],
        rounded_down(case.force_reserve_N, " N"),
        _direction(case.force_weakest),
        rounded_down(case.horizontal_reserve_N, " N"),
        _direction(case.horizontal_weakest),
        rounded_down(case.torque_reserve_Nm, " N m"),
        _direction(case.torque_weakest),
        rounded_down(case.load_factor, "", 4),
        inputs,
        "" if case.inputs_at_limit is None else str(case.inputs_at_limit),
    ]


def joint_loads(flight: Flight) -> Table | None:
    """Return the largest moment of each joint with its load case; None without joints."""
    worst = {load.child: load for load in sorted(flight.joints, key=lambda load: load.moment_Nm)}
    rows = [
        {
            "joint": f"port {PORT_NAMES[load.port]} of module {load.module} to module {load.child}",
            "case": load.case,
            "force": rounded_up(load.force_N, " N"),
            "moment": rounded_up(load.moment_Nm, " N m"),
            "about the hinge": rounded_up(load.about_hinge_Nm, " N m"),
            "across the hinge": rounded_up(load.across_hinge_Nm, " N m"),
        }
        for _, load in sorted(worst.items())
    ]
    return Table.from_rows(rows, {2, 3, 4, 5}) if rows else None


def _direction(v: Vector | None) -> str:
    return "" if v is None else direction(v)
