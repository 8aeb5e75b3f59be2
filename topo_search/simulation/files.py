"""The files of a flight: the time series of every scenario as a table and as a plot, and a video."""

from __future__ import annotations

import io
import itertools
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from topo_search.export import PAPER, TWO_COLUMNS, palette
from topo_search.model import Array, BadInput, Design, Fault
from topo_search.model.files import to_json, write_atomically
from topo_search.model.text import csv_text
from topo_search.simulation.result import FlightResult, ScenarioResult, word
from verify.kinematics import platform

if TYPE_CHECKING:  # MuJoCo loads a graphics library, which may be missing
    from topo_search.simulation.campaign import Campaign, FlownScenario
    from topo_search.simulation.fly import Watch
    from topo_search.simulation.plant import Plant

FRAMES_EVERY = 16
"""Control steps per frame: 12.5 Hz in real time."""
POSE = ("x_m", "y_m", "z_m", "q_w", "q_x", "q_y", "q_z")
"""Columns of `Track.pose`."""
WIDTH, HEIGHT = 1280, 720
"""Size of a frame [pixels]."""


def write_flight(campaign: Campaign, folder: Path) -> None:
    """Write flight.csv, flight.png if anything was flown, and last flight.json; create the folder if necessary."""
    write_atomically(folder / "flight.csv", time_series(campaign.flown))
    if campaign.flown:
        write_atomically(folder / "flight.png", plot(campaign.flown, campaign.result))
    write_atomically(folder / "flight.json", to_json(campaign.result))


def time_series(flown: Sequence[FlownScenario]) -> str:
    """Return the time series of the flights as CSV."""
    head = ("scenario", "time_s", "error_x_m", "error_y_m", "error_z_m", "tilt_deg", "force_x_N", "force_y_N")
    every = 4  # control steps per row: 50 Hz
    rows = [
        (
            *(scenario.name, round(track.time[k], 6), *track.error[k].tolist(), track.tilt[k]),
            *(*track.force[k].tolist(), float(track.shares[k].max()), float(track.shares[k].mean())),
            *(float(np.linalg.norm(track.missing[k][:3])), *track.pose[k].tolist()),
        )
        for scenario, track in flown
        for k in range(0, len(track.time), every)
    ]
    return csv_text((*head, "force_z_N", "largest_input", "mean_input", "missing_force_share", *POSE), rows)


def plot(flown: Sequence[FlownScenario], result: FlightResult) -> bytes:
    """Return a PNG picture of the flights, one row each with position error, tilt and largest thrust."""
    from matplotlib import style

    with style.context(PAPER):
        return _plot(flown, {scenario.name: scenario for scenario in result.scenarios})


def _plot(flown: Sequence[FlownScenario], results: dict[str, ScenarioResult]) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(TWO_COLUMNS, 1.3 * len(flown) + 0.4))
    figure.suptitle("flight in simulation; grey: not judged; dashed: limit")
    axes = figure.subplots(len(flown), 3, squeeze=False, sharex="row")
    for row, (scenario, track) in zip(axes, flown, strict=True):
        e = 100 * np.linalg.norm(track.error, axis=1)
        curves = (e, np.array(track.tilt), np.array([share.max() for share in track.shares]))
        limits = (100 * scenario.largest_drift, scenario.largest_tilt, 1.0)
        names = ("position\nerror [cm]", "tilt [deg]", "largest thrust\nover limit")
        for axis, curve, limit, name in zip(row, curves, limits, names, strict=True):
            axis.plot(track.time, curve, color=palette.MODULE, linewidth=0.8)
            axis.axhline(limit, color=palette.END_EFFECTOR, linewidth=0.8, linestyle="--")
            axis.axvspan(0, scenario.judged_from, color="0.93")
            axis.set_ylabel(name)
            axis.set_ylim(0, 1.05 * max(limit, float(curve.max())))
        row[0].set_title(f"{scenario.name}: {word(results[scenario.name])}", loc="left")
        row[1].set_xlabel("time [s]")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=150, metadata={"Software": None})
    return content.getvalue()


class Film:
    """Frames of selected scenarios, rendered without a display."""

    def __init__(self, radius: float) -> None:
        """Start a film of a platform of the given radius [m]."""
        import mujoco

        self.frames: list[bytes] = []
        """PNG files, since pictures would fill the memory."""
        self._plant: Plant | None = None
        self._camera = mujoco.MjvCamera()
        self._camera.distance, self._camera.elevation, self._camera.azimuth = 2.1 * radius, -20.0, 135.0

    def watch(self, name: str) -> Watch | None:
        """Return an observer that films a scenario; None if the scenario is not filmed."""
        is_filmed = name.startswith(("return from +x", "load case", "rotor"))
        return partial(self._film_step, name) if is_filmed else None

    def _film_step(self, name: str, plant: Plant, t: float) -> None:
        import mujoco

        if plant is not self._plant:
            self._plant, self._steps = plant, itertools.count()
            plant.model.vis.global_.offwidth, plant.model.vis.global_.offheight = WIDTH, HEIGHT
            self._renderer: Any = mujoco.Renderer(plant.model, HEIGHT, WIDTH)
        if next(self._steps) % FRAMES_EVERY == 0:
            self._renderer.update_scene(plant.data, self._camera)
            self.frames.append(_with_caption(self._renderer.render(), f"{name}, {t:.1f} s"))

    def encode(self, suffix: str) -> bytes:
        """Return the film as the content of an animated `.gif`, or of a `.webp`, which is much smaller."""
        from PIL import Image

        content = io.BytesIO()
        first, *rest = (Image.open(io.BytesIO(frame)) for frame in self.frames)
        of_gif, of_webp = {"optimize": False}, {"quality": 70, "method": 2}
        options: dict[str, Any] = {"duration": 80, "loop": 0, **of_gif, **of_webp}
        first.save(content, suffix.removeprefix("."), save_all=True, append_images=rest, **options)
        return content.getvalue()


def _with_caption(pixels: Array, words: str) -> bytes:
    """Return a frame with its caption as PNG, in 128 colours, so that films stay small."""
    from PIL import Image, ImageDraw, ImageFont

    frame = Image.fromarray(pixels)
    ImageDraw.Draw(frame).text((24, HEIGHT - 56), words, fill=palette.MODULE, font=ImageFont.load_default(32))
    content = io.BytesIO()
    frame.quantize(128, dither=Image.Dither.NONE).save(content, format="PNG", compress_level=1)
    return content.getvalue()


def film(path: Path, radius: float) -> Film:
    """Return a film that will be written to a file.

    Raises:
        BadInput: the file is neither a .gif nor a .webp, or rendering is not possible here.
    """
    if path.suffix.lower() not in (".gif", ".webp"):
        raise BadInput("--video", [Fault("", f"must end in .gif or .webp, but got {path.name}")])
    try:
        import mujoco

        model = mujoco.MjModel.from_xml_string("<mujoco/>")
        mujoco.Renderer(model, 8, 8).close()
    except Exception as error:  # noqa: BLE001 (each graphics library fails in its own way)
        backend = os.environ.get("MUJOCO_GL", "not set")
        rule = f"cannot be rendered here (MUJOCO_GL is {backend}; egl needs no display): {error}"
        raise BadInput("--video", [Fault("", rule)]) from None
    return Film(radius)


def radius(design: Design) -> float:
    """Return the radius of a ball about the centre of mass that contains the design [m]."""
    built, types = platform(design), design.task.types
    reach = max(max(kind.arm_length + kind.body.rotor_radius, kind.connector_distance) for kind in types)
    distances = np.linalg.norm(np.concatenate([built.p - built.p_com, built.p_e[None]]), axis=1)
    return float(distances.max()) + reach
