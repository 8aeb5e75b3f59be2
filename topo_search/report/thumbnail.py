"""A small picture of a platform, so that designs can be told apart in a table."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from topo_search.export import palette
from topo_search.export.poses import Poses, azimuth_deg, towards_viewer
from topo_search.model import Design
from topo_search.model.arrays import Array

CORNERS = 10
"""Number of corners of a rotor's disc."""


def thumbnail(design: Design, at: Poses, side: int = 36) -> Markup:
    """Return rotors, arms and the end-effector as inline SVG, seen as in the page's view of the design.

    Args:
        design: any design.
        at: its poses.
        side: edge of the picture [px].
    """
    towards = towards_viewer(azimuth_deg(at))
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, towards)])  # right and down, as pixels count
    angles = np.linspace(0.0, 2 * np.pi, CORNERS, endpoint=False)
    circle = design.task.module.body.rotor_radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    hubs = at.p_com + at.rotors
    discs = hubs[:, :, None] + np.einsum("nij,cj->nci", at.R, circle)[:, None]
    everything = np.concatenate([discs.reshape(-1, 3), at.end_effector[None]]) @ axes.T
    low, high = everything.min(axis=0), everything.max(axis=0)
    tip = max(3, side // 40)
    scale = (side - 2 * tip) / max(*(high - low), 1e-9)

    def pixels(points: Array) -> str:
        flat = side / 2 + scale * (points @ axes.T - (low + high) / 2)
        return " ".join(f"{u:.0f},{v:.0f}" for u, v in flat)

    back_first = np.argsort((hubs @ towards).ravel())
    arms = "".join(f'<path d="M{pixels(hub[[0, 2]])}M{pixels(hub[[1, 3]])}"/>' for hub in hubs)
    rotors = "".join(f'<polygon points="{pixels(discs.reshape(-1, CORNERS, 3)[i])}"/>' for i in back_first)
    x, y = pixels(at.end_effector[None]).split(",")
    return Markup(
        f'<svg class="thumbnail" width="{side}" height="{side}" viewBox="0 0 {side} {side}" aria-hidden="true">'
        f'<g stroke="{palette.ARM}">{arms}</g><g fill="{palette.ROTOR}" stroke="{palette.MODULE}">{rotors}</g>'
        f'<circle cx="{x}" cy="{y}" r="{tip}" fill="{palette.END_EFFECTOR}"/></svg>'
    )
