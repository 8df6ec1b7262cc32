"""Panels of sensors: images of the cameras; plots of joints, tracking error, wrench and gripper over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.logs import CameraImage, ImageEvent, Stamped, series

from .packing import Packable, Section, quantise

IMAGE_BYTE_LIMIT: Final = 1_000_000
"""Maximum size of all images together, bytes; base64 adds a third."""
_WEBP_QUALITIES: Final = (80, 60, 45)
_MIN_IMAGE_WIDTH: Final = 160
"""Minimum width of a readable image, pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportImage:
    """Image as the page shows it: WebP files of colour and depth."""

    camera: str
    time: float
    colour: bytes
    depth: bytes
    nearest: float
    """Depth of the first colour of the scale, m; `farthest` is that of the last."""
    farthest: float


def pack_images(run: Run, budget: int = IMAGE_BYTE_LIMIT) -> Section:
    """Pack all images, or as many as `budget` bytes hold, evenly over the run."""
    shots = run.images
    if not shots:
        return Section("images", {"empty": "No camera took an image in this run."})
    pictures = images_within_budget(shots, budget)
    images = ((at.time, at.record) for at in run.events if isinstance(at.record, ImageEvent))
    findings = {round(time, 3): image.findings for time, image in images}
    left_out = len(shots) - len(pictures)
    return Section(
        "images",
        {
            "images": [
                _packed_image(picture, findings.get(round(picture.time, 3), ())) for picture in pictures
            ],
            "note": f"{left_out} of {len(shots)} images are left out to keep this page small."
            if left_out
            else "",
        },
    )


def images_within_budget(shots: Sequence[Stamped[CameraImage]], budget: int) -> list[ReportImage]:
    """Return the images in the best quality that `budget` allows.

    When even the smallest are too many, return fewer, the first and the last among them. The others are not
    decoded.
    """
    some = [shots[k] for k in range(0, len(shots), max(len(shots) // 8, 1))]
    width = quality = count = 0
    for width, quality in _widths_and_qualities(some[0].record.colour.shape[1]):
        sizes = [len(picture.colour) + len(picture.depth) for picture in _pictures(some, width, quality)]
        count = int(budget * len(sizes) / (1.1 * sum(sizes)))
        if count >= len(shots):
            return _pictures(shots, width, quality)
    chosen = sorted({round(float(k)) for k in np.linspace(0, len(shots) - 1, max(count, 1))})
    return _pictures((shots[k] for k in chosen), width, quality)


def _widths_and_qualities(width: int) -> list[tuple[int, int]]:
    """Return widths and qualities, from the best to the lowest."""
    whole = min(width, 640)
    small = [(max(whole // 2, _MIN_IMAGE_WIDTH), 60)] if whole > _MIN_IMAGE_WIDTH else []
    return [*((whole, quality) for quality in _WEBP_QUALITIES), *small]


def _pictures(shots: Iterable[Stamped[CameraImage]], width: int, quality: int) -> list[ReportImage]:
    return [_picture(shot, width, quality) for shot in shots]


def _picture(at: Stamped[CameraImage], width: int, quality: int) -> ReportImage:
    shot = at.record
    known = shot.depth[shot.depth > 0.0]
    nearest, farthest = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    colour = cv2.cvtColor(shot.colour, cv2.COLOR_RGB2BGR).astype(np.uint8)
    return ReportImage(
        shot.camera,
        at.time,
        _webp(colour, width, quality),
        _webp(_depth_image(shot.depth, nearest, farthest), width, quality),
        nearest,
        farthest,
    )


def _depth_image(depth: NDArray[np.float32], nearest: float, farthest: float) -> NDArray[np.uint8]:
    """Return depth as BGR: bright is near, black is unknown."""
    span = max(farthest - nearest, 1e-6)
    levels = np.clip(255.0 * (farthest - depth) / span, 0.0, 255.0).astype(np.uint8)
    coloured = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    coloured[depth <= 0.0] = 0
    return coloured


def _webp(image: NDArray[np.uint8], width: int, quality: int) -> bytes:
    height = max(round(image.shape[0] * width / image.shape[1]), 1)
    if width < image.shape[1]:
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
    done, data = cv2.imencode(".webp", image, (cv2.IMWRITE_WEBP_QUALITY, quality))
    if not done:
        raise ValueError("the image cannot be encoded")
    return data.tobytes()


def _packed_image(picture: ReportImage, findings: Sequence[str]) -> Packable:
    return {
        **{name: getattr(picture, name) for name in ("camera", "time", "nearest", "farthest")},
        **{name: np.frombuffer(getattr(picture, name), dtype=np.uint8) for name in ("colour", "depth")},
        "findings": list(findings),
    }


Floats = NDArray[np.float64]
MAX_CURVE_POINTS: Final = 8000
"""Maximum number of points of a curve.

Of a longer one only the minimum and the maximum of each stretch remain, so that no peak is lost.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PlotCurve:
    label: str
    values: Floats
    """Values of the curve, (n,); NaN: no value."""


@dataclass(frozen=True, slots=True, eq=False)
class CurvePlot:
    """Curves over the same times (n,), in one unit. `step`: rounding in the page."""

    name: str
    title: str
    unit: str
    step: float
    times: Floats
    curves: tuple[PlotCurve, ...]
    note: str = ""


def pack_plots(run: Run) -> Section:
    plots = [thin_plot(plot) for plot in plots_of(run) if plot.curves and len(plot.times)]
    if not plots:
        return Section("plots", {"empty": "The log holds neither joints nor forces."})
    return Section("plots", {"plots": [_packed_plot(plot) for plot in plots]})


def plots_of(run: Run) -> tuple[CurvePlot, ...]:
    """Return all plots in full; without data in the log, a plot has no curves."""
    arm, fingers = run.joint_names
    joints, controls = run.joints, run.controls
    return (
        *_joint_plots(joints, arm),
        _tracking(joints, controls),
        *_wrench_plots(run.wrenches),
        *_gripper_plots(joints, fingers),
    )


def thin_plot(plot: CurvePlot, most: int = MAX_CURVE_POINTS) -> CurvePlot:
    """Return the plot with at most `most` points: minimum and maximum of each curve in each stretch, in order
    of time."""
    n = len(plot.times)
    if n <= most:
        return plot
    size = -(-n // (most // 2))
    starts = np.arange(0, n, size)
    middles = np.minimum(starts + size // 2, n - 1)
    times = np.stack([plot.times[starts], plot.times[middles]], axis=1).ravel()
    curves = tuple(PlotCurve(curve.label, _extremes(curve.values, size)) for curve in plot.curves)
    note = f"{plot.note} " if plot.note else ""
    return replace(
        plot,
        times=times,
        curves=curves,
        note=f"{note}Each point shows the least and the greatest value of {size} ticks.",
    )


def _extremes(values: Floats, size: int) -> Floats:
    """Return minimum and maximum of each stretch, (2 · stretches,); NaN where it holds nothing else."""
    padded = np.concatenate([values, np.full(-len(values) % size, np.nan)]).reshape(-1, size)
    gaps = np.isnan(padded)
    low = np.where(gaps, np.inf, padded).argmin(axis=1)
    high = np.where(gaps, -np.inf, padded).argmax(axis=1)
    rows = np.arange(len(padded))
    return np.stack(
        [padded[rows, np.minimum(low, high)], padded[rows, np.maximum(low, high)]], axis=1
    ).ravel()


def _joint_plots(joints: series.JointSeries, names: Sequence[str]) -> tuple[CurvePlot, ...]:
    arm = [joints.column(name) for name in names]
    labels = _without_common_prefix(names)

    def plot(name: str, title: str, unit: str, step: float, values: Floats) -> CurvePlot:
        curves = tuple(PlotCurve(label, values[:, k]) for label, k in zip(labels, arm, strict=True))
        return CurvePlot(name, title, unit, step, joints.times, curves)

    return (
        plot("position", "Joint positions", "rad", 1e-4, joints.positions),
        plot("velocity", "Joint velocities", "rad/s", 1e-3, joints.velocities),
    )


def _tracking(joints: series.JointSeries, controls: series.ControlSeries) -> CurvePlot:
    """Return the plot of the joints' deviations from the servo's set points."""
    labels = _without_common_prefix(joints.names[: controls.errors.shape[1]])
    curves = tuple(PlotCurve(label, 1000.0 * controls.errors[:, k]) for k, label in enumerate(labels))
    return CurvePlot(
        "tracking", "Tracking error", "mrad", 1e-3, controls.times, curves,
        "Set point of the servo minus its position; no values during compliant motions.",
    )  # fmt: skip


def _wrench_plots(wrenches: series.WrenchSeries) -> tuple[CurvePlot, ...]:
    force, torque = wrenches.forces, wrenches.torques
    size = np.linalg.norm(force, axis=1)
    return (
        CurvePlot(
            "force", "Force on the wrist", "N", 0.01, wrenches.times,
            (*(PlotCurve(axis, force[:, k]) for k, axis in enumerate("xyz")), PlotCurve("size", size)),
            "External, in the axes of the world.",
        ),
        CurvePlot(
            "torque", "Torque on the wrist", "Nm", 1e-3, wrenches.times,
            tuple(PlotCurve(axis, torque[:, k]) for k, axis in enumerate("xyz")),
            "External, in the axes of the world.",
        ),
    )  # fmt: skip


def _gripper_plots(joints: series.JointSeries, fingers: Sequence[str]) -> tuple[CurvePlot, ...]:
    held = [k for k, name in enumerate(joints.names) if name in fingers]
    if not held:
        return ()
    width = 1000.0 * joints.positions[:, held].sum(axis=1)
    force = joints.efforts[:, held].max(axis=1)
    return (
        CurvePlot("width", "Gripper width", "mm", 0.01, joints.times, (PlotCurve("width", width),)),
        CurvePlot("grip", "Grip force", "N", 0.01, joints.times, (PlotCurve("force", force),)),
    )


def _packed_plot(plot: CurvePlot) -> Packable:
    return {
        **{name: getattr(plot, name) for name in ("name", "title", "unit", "note")},
        "times": quantise(plot.times, 1e-3),
        "labels": [curve.label for curve in plot.curves],
        "values": [quantise(curve.values, plot.step) for curve in plot.curves],
    }


def _without_common_prefix(names: Sequence[str]) -> list[str]:
    """Return the names without their common prefix."""
    if len(names) < 2:
        return list(names)
    common = 0
    while len({name[: common + 1] for name in names}) == 1 and len(names[0]) > common:
        common += 1
    while common and names[0][common - 1].isdigit():
        common -= 1
    kept = [name[common:] for name in names]
    return [f"j{name}" if name.isdigit() else name for name in kept] if all(kept) else list(names)
