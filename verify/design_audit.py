"""The audit of a whole design, derived again from its task, topology, angles, p'_E, u and mount alone.

The verdict is the worst status among the residuals and the clearances that count. The solver keeps a margin; the
audit's own threshold is zero.
"""

import functools
import itertools
import platform as python_platform
import sys
import time
from collections.abc import Sequence
from importlib import metadata

import numpy as np

from topo_search.model import Array, Audit, Clearance, Design, Geometry, Module, Status, Vector
from topo_search.model.features import StatedCheck
from verify.certificate import Certificate, RoundBody
from verify.contacts import AnyCheck, allowed_contacts, certify
from verify.features import CLEARANCES, SECTIONS, assembly, complete, interference
from verify.requirements import Scene
from verify.residuals import clamp, residuals
from verify.sections import Findings

MOST_CLEARANCES = 1_000_000
"""Largest number of clearances in an audit, as many as 380 modules and 50 paths have; more would need gigabytes."""


def audit(design: Geometry) -> Audit:
    """Return the audit of a design, or of a geometry with its best inputs; pure except for `seconds`.

    python-fcl is native code that can crash: a caller that must survive runs this in a child process.

    Raises:
        ValueError: the design has more than MOST_CLEARANCES clearances.
    """
    started = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):  # absurd inputs overflow; the audit then proves nothing
        return _audit(complete(design), started)


def _audit(design: Design, started: float) -> Audit:
    scene = Scene(design)
    sheet = assembly(scene)  # its mount, where the rod starts, decides which clearances there are
    all_checks = (check for group in CLEARANCES for check in group.checks(scene, sheet.mount))
    checks = list(itertools.islice(all_checks, MOST_CLEARANCES + 1))
    if len(checks) > MOST_CLEARANCES:
        raise ValueError(f"a design may have at most {MOST_CLEARANCES:,} clearances, but this one has more")
    found = Findings(scene, sheet, CLEARANCES, checks, certify(checks), {})
    rows = [*residuals(design, scene.platform)]
    for section in SECTIONS:
        if section.find is not None:
            found.figures[section.field] = section.find(found)
        rows += section.residuals(found)
    counted = [row.status for check, row in zip(checks, found.certificates, strict=True) if check.counts]
    pairs = _clearances(found)
    return Audit(
        inputs_computed=design.inputs_computed,
        verdict=Status.worst([*(row.status for row in rows), *counted]),
        pairs=pairs,
        residuals=tuple(rows),
        interference=None if design.task.search.interference == "parts" else interference(pairs),
        stated=tuple(StatedCheck(**claim.model_dump(), status="not checked") for claim in design.stated),
        assembly=sheet,
        allowed_contacts=allowed_contacts(design, sheet.mount),
        versions=dict(_versions()),
        seconds=time.perf_counter() - started,
        **found.figures,
    )


def _clearances(found: Findings) -> tuple[Clearance, ...]:
    """Return the clearance of every check, in the order of the checks."""
    scene = found.scene
    modules = scene.design.task.modules_of_nodes
    middle = scene.platform.p_com + scene.platform.o.mean(axis=0)  # the scene's origin in W
    closest = _closest_points(found.checks, found.certificates, scene.l_arm, middle)
    rows = zip(found.checks, found.certificates, closest, strict=True)
    return tuple(_clearance(*row, scene.l_arm, modules) for row in rows)


def _closest_points(
    checks: Sequence[AnyCheck], certificates: Sequence[Certificate], l_arm: float, middle: Array
) -> list[tuple[Vector, Vector] | None]:
    """Return the closest points of each check's sides in W [m]; for a minimum distance, the ball centres."""

    def points(check: AnyCheck, certificate: Certificate) -> Array:
        A, B, has_centres = check.body, check.against, check.kind in ("separation", "exclusion")
        if has_centres and isinstance(A, RoundBody) and isinstance(B, RoundBody):
            return np.stack([A.body.o, B.body.o])
        return np.full((2, 3), np.nan) if certificate.closest is None else certificate.closest

    pairs = [points(check, certificate) for check, certificate in zip(checks, certificates, strict=True)]
    closest = l_arm * np.array(pairs).reshape(-1, 2, 3) + middle
    finite = np.asarray(np.isfinite(closest).all(axis=(1, 2)))
    return [(a, b) if is_known else None for (a, b), is_known in zip(closest.tolist(), finite, strict=True)]


def _clearance(
    check: AnyCheck,
    certificate: Certificate,
    closest: tuple[Vector, Vector] | None,
    l_arm: float,
    modules: Sequence[Module],
) -> Clearance:
    d, percent = clamp(certificate.analytic * l_arm), None
    if check.kind == "airflow":
        percent = clamp(100.0 * d / sum(modules[i].envelope.end_radius for i in (check.a, check.b)))
    lower, upper = (None if bound is None else bound * l_arm for bound in (certificate.lower, certificate.upper))
    return Clearance(
        kind=check.kind,
        a=check.a,
        b=check.b,
        segment=check.segment,
        contact=check.contact,
        rotor=check.rotor,
        status=certificate.status,
        lower_m=lower,
        upper_m=upper,
        analytic_m=d,
        level=certificate.level,
        percent=percent,
        evidence=(*_describe(check), *certificate.evidence) if certificate.evidence else (),
        closest_m=closest,
    )


def _describe(check: AnyCheck) -> tuple[str, str]:
    """Return both sides of a check with all digits, in l_arm from the mean of the module centres."""
    sides = (side.body if isinstance(side, RoundBody) else side for side in (check.body, check.against))
    with np.printoptions(floatmode="unique", threshold=sys.maxsize):
        body, against = (" ".join(repr(side).split()) for side in sides)
    return f"body: {body}", f"against: {against}"


@functools.cache
def _versions() -> tuple[tuple[str, str], ...]:
    packages = "topo-search", "numpy", "python-fcl", "scipy"
    return (("python", python_platform.python_version()), *((name, metadata.version(name)) for name in packages))
