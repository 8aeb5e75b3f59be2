r"""Poses of all modules as symbols (paper, Sec. II).

| symbol | meaning | shape | unit |
|---|---|---|---|
| psi, alpha_0, alpha_1 | root orientation | scalars | rad |
| alpha_i | hinge angle of the joint of module i > 0 with its parent | scalar | rad |
| R_i, p_i | orientation and position of module i in W | (3,3), (3,) | -, l_arm |
| e_a | direction of port a in the module frame: +x, +y, -x, -y | (3,) | |

.. math::

    R_{root} = R_z(\psi) R_x(\alpha_0) R_y(\alpha_1), \qquad p_{root} = 0

    R_i = R_h H_a(\alpha_i) R_z(\kappa \pi/2), \qquad p_i = p_h + l_c R_h e_a + l_c R_h H_a(\alpha_i) e_a

with H_a = Ry for ports on the x axis and Rx for ports on the y axis, kappa = (a + 2 - b) mod 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from topo_search.model import Topology
from topo_search.model.layout import PORT_DIRECTIONS


@dataclass(frozen=True)
class Pose:
    """Pose of a module: R (3x3) and p (3)."""

    R: ca.SX
    p: ca.SX

    @property
    def z(self) -> ca.SX:
        """The thrust axis R e_z."""
        return self.R[:, 2]


def Rx(angle: ca.SX) -> ca.SX:
    """Return the rotation about x."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[1, 0, 0], [0, c, -s], [0, s, c]])


def Ry(angle: ca.SX) -> ca.SX:
    """Return the rotation about y."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def Rz(angle: ca.SX) -> ca.SX:
    """Return the rotation about z."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def quarter_turns(kappa: int) -> ca.SX:
    """Return Rz(kappa pi/2) with exact zeros and ones."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[kappa % 4]
    return ca.SX(ca.DM([[c, -s, 0], [s, c, 0], [0, 0, 1]]))


def poses(topology: Topology, root: ca.SX, alpha: ca.SX, l_c: float) -> list[Pose]:
    """Return the poses of all modules, in module order.

    Args:
        topology: the tree.
        root: psi, alpha_0, alpha_1 [rad].
        alpha: hinge angles of the modules 1..n-1 [rad].
        l_c: module centre to connector, in the unit of length of the result.
    """
    psi, alpha_0, alpha_1 = root[0], root[1], root[2]
    result = [Pose(R=Rz(psi) @ Rx(alpha_0) @ Ry(alpha_1), p=ca.SX.zeros(3))]
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        parent, e_a = result[h], ca.DM(PORT_DIRECTIONS[a])
        hinge = Ry(alpha[i - 1]) if a % 2 == 0 else Rx(alpha[i - 1])
        R_hinge = parent.R @ hinge
        p_i = parent.p + l_c * (parent.R @ e_a) + l_c * (R_hinge @ e_a)
        result.append(Pose(R=R_hinge @ quarter_turns(kappa), p=p_i))
    return result
