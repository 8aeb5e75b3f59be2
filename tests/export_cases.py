"""Designs for the tests of the exports."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from older import older_task

from topo_search.export.mjcf import SPIN
from topo_search.model import Design, Mount, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.topologies import sample
from verify.kinematics import platform

Array = NDArray[np.float64]


def random_design(topology: Topology, seed: int, task: dict[str, Any] | None = None) -> Design:
    """A design whose numbers are drawn; it need not do anything useful."""
    rng = np.random.default_rng(seed)
    n = topology.n
    fields = {"name": "drawn", "modules": n, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}], **(task or {})}
    resolved = older_task(fields).resolve(n)
    u_max = resolved.module.max_input(resolved.gravity)
    return Design(
        task=resolved,
        topology=topology,
        root_orientation_rad=tuple(rng.uniform([-3, -1.5, -3], [3, 1.5, 3]).tolist()),
        hinge_angles_rad=tuple(rng.uniform(-1.5, 1.5, n - 1).tolist()),
        end_effector_m=tuple(rng.uniform(-1, 1, 3).tolist()),
        rotor_speeds_squared=(tuple(rng.uniform(0, u_max, resolved.rotor_count).tolist()),),
        objective=1.0,
    )


def drawn_trees() -> list[Topology]:
    """Trees of several sizes, with aligned and with any connectors."""
    return [
        Topology.from_key("a0"),
        *(tree for n in (2, 5, 9) for tree in sample(n, 2, n)),
        *(tree for n in (3, 5, 9) for tree in sample(n, 2, n, connectors="any")),
    ]


WEDGE = np.array([[0.0, 0, 0], [0.12, 0, 0], [0, 0.09, 0], [0, 0, 0.06]]) - 0.01
BLOCK = np.array([[x, y, z] for x in (-0.05, 0.02) for y in (-0.03, 0.04) for z in (-0.02, 0.01)])
OWN_FRAME = {
    "inertia": [1e-3, 1e-3, 1.8e-3],
    "frame": [
        {"vertices": WEDGE.tolist(), "triangles": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]},
        {
            "vertices": BLOCK.tolist(),
            "triangles": [
                *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
                *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
            ],
        },
    ],
}
"""A module's body whose frame is a tetrahedron and a box, neither about the centre."""


def with_rod(design: Design) -> Design:
    """The design with its end-effector on a rod from the last free connector."""
    module, port = design.topology.free_connectors[-1]
    return design.model_copy(update={"mount": Mount(module=module, port=port)})


def rod_ends(design: Design) -> Array:
    """Connector and tip of that rod, in W."""
    at, l_c = platform(design), design.task.module.connector_distance
    module, port = design.topology.free_connectors[-1]
    start = at.poses.p[module] + l_c * at.poses.R[module] @ PORT_DIRECTIONS[port]
    return np.stack([start, design.end_effector_m])


def inertia_about_com(design: Design) -> Array:
    """The inertia of the whole platform about its COM by the parallel axis theorem, in W's axes."""
    task, module, at = design.task, design.task.module, platform(design)
    edges, own = design.topology.edges(), [R @ np.diag(module.inertia) @ R.T for R in at.poses.R]
    joints = [at.o[h] + module.connector_distance * at.poses.R[h] @ PORT_DIRECTIONS[a] for h, _, a, _ in edges]
    masses = [*[module.mass] * len(own), *[module.joint_mass] * len(joints), task.end_effector.mass]
    J = np.sum(own, axis=0)
    for m, r in zip(masses, [*at.o, *joints, at.p_e], strict=True):
        J = J + m * (r @ r * np.eye(3) - np.outer(r, r))
    return np.asarray(J)


def exported_inertia(design: Design) -> Array:
    """The inertia of the exported model: the bodies of points turn like small balls."""
    return inertia_about_com(design) + (design.topology.n + 1) * SPIN * np.eye(3)


def in_mujoco(text: str) -> tuple[Any, Any]:
    """The model of a file, and its data at the start."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mass_matrix(model: Any, data: Any) -> Array:
    """Return the mass matrix of a single floating body, (6, 6)."""
    M = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, M)
    return M
