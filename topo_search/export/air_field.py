"""Air speeds on a grid, for NumPy (.npz) and ParaView (.vti, image data of VTK)."""

from __future__ import annotations

import base64
import io
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from topo_search.model import Design
from verify.air import case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene

POINTS = 200_000
"""Largest number of a grid's points."""
AROUND, BELOW = 0.5, 2.0
"""Room around modules and end-effector, and along their jets [m]."""


class AirField(NamedTuple):
    """Air speeds of a design, from the root's centre in the axes of the task."""

    origin: NDArray[np.float64]
    """First point of the grid, shape (3,) [m]."""
    step: float
    """Distance of neighbours [m]."""
    cases: dict[str, NDArray[np.float32]]
    """Sum of the modules' speeds in every load case, shape (nx, ny, nz) [m/s]."""


def air_field(design: Design, points: int = POINTS) -> AirField:
    """Return the air of a design around its modules, its end-effector and its jets, at no more than some points.

    The speeds are those of `verify.air.jets`: time averages in free air.
    """
    placed = platform(design)
    scene = Scene(design, placed)
    W = placed.poses.p
    middle = W.mean(axis=0)
    ends = np.concatenate([W, W - BELOW * placed.poses.z, [middle + scene.l_arm * scene.p_E]])
    low, high = ends.min(axis=0) - AROUND, ends.max(axis=0) + AROUND
    step = float((np.prod(high - low) / points) ** (1 / 3))
    while np.prod(counts := np.floor((high - low) / step).astype(int) + 1) > points:
        step *= 1.01
    grid = np.stack(np.meshgrid(*(low[a] + step * np.arange(counts[a]) for a in range(3)), indexing="ij"), axis=-1)
    x = (grid.reshape(-1, 3) - middle) / scene.l_arm
    fields = {}
    for name, blown in case_jets(design, placed, scene):
        parts = np.array_split(x, max(1, len(x) * len(W) // 50_000))
        fields[name] = np.concatenate([speeds(blown, part).sum(axis=1) for part in parts]).astype(np.float32)
    return AirField(low, step, {name: field.reshape(tuple(counts)) for name, field in fields.items()})


def npz(field: AirField) -> bytes:
    """Return the content of an .npz file: `case` (K,), `speed_m_s` (K, nx, ny, nz), `origin_m` (3,), `step_m`."""
    stream = io.BytesIO()
    speed = np.stack(list(field.cases.values()))
    np.savez_compressed(
        stream, case=np.array(list(field.cases)), speed_m_s=speed, origin_m=field.origin, step_m=field.step
    )
    return stream.getvalue()


def vti(field: AirField) -> str:
    """Return the text of a .vti file: an array of point data for every load case."""
    shape = next(iter(field.cases.values())).shape
    extent = " ".join(f"0 {count - 1}" for count in shape)
    arrays = []
    for name, speed in field.cases.items():
        data = speed.ravel(order="F").astype("<f4").tobytes()
        packed = base64.b64encode(np.uint32(len(data)).tobytes() + data).decode()
        label = quoteattr(f"{name} [m/s]")
        arrays.append(f'<DataArray type="Float32" Name={label} format="binary">{packed}</DataArray>')
    origin = " ".join(f"{x:.9g}" for x in field.origin)
    return (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="0.1" byte_order="LittleEndian">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{" ".join([f"{field.step:.9g}"] * 3)}">\n'
        f'<Piece Extent="{extent}"><PointData>\n' + "\n".join(arrays) + "\n</PointData></Piece>\n"
        "</ImageData>\n</VTKFile>\n"
    )
