"""What is packed of camera, joints, forces and gripper: images within a budget, curves in few points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.analysis import Run
from picktree.analysis.report.sensor_panels import (
    CurvePlot,
    PlotCurve,
    images_within_budget,
    pack_images,
    pack_plots,
    plots_of,
    thin_plot,
)
from picktree.logs import CameraImage, Stamped
from picktree.world import Intrinsics

from ..logs.scripted_log import record, tree


def shots(count: int) -> list[Stamped[CameraImage]]:
    """Pictures with some texture, a second apart."""
    rng = np.random.default_rng(5)
    rough = rng.integers(0, 255, (30, 40, 3), dtype=np.uint8)
    colour = cv2.resize(rough, (320, 240), interpolation=cv2.INTER_CUBIC).astype(np.uint8)
    depth = np.linspace(0.5, 0.9, 240 * 320, dtype=np.float32).reshape(240, 320)
    intrinsics = Intrinsics(320, 240, 280.0, 280.0, 160.0, 120.0)
    return [Stamped(float(k), CameraImage("overhead", colour, depth, intrinsics)) for k in range(count)]


def opened(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def test_images_look_as_they_did_and_depth_is_a_scale_of_colours() -> None:
    (source,) = shots(1)
    (picture,) = images_within_budget([source], 1_000_000)
    seen = cv2.cvtColor(opened(picture.colour), cv2.COLOR_BGR2RGB)
    assert seen.shape == (240, 320, 3)
    assert np.abs(seen.astype(int) - source.record.colour.astype(int)).mean() < 6
    assert (picture.nearest, picture.farthest) == pytest.approx((0.5, 0.9))
    depth = opened(picture.depth)
    near, far = depth[2, 2].astype(int), depth[-3, -3].astype(int)
    assert near.sum() > far.sum() + 150


@pytest.mark.parametrize("budget", [120_000, 60_000, 20_000])
def test_all_images_together_keep_to_their_budget(budget: int) -> None:
    pictures = images_within_budget(shots(20), budget)
    assert sum(len(p.colour) + len(p.depth) for p in pictures) <= budget
    assert pictures[0].time == 0.0
    if len(pictures) > 1:
        assert pictures[-1].time == 19.0


def test_a_small_budget_costs_quality_before_it_costs_images() -> None:
    good, fair = images_within_budget(shots(20), 1_000_000), images_within_budget(shots(20), 300_000)
    assert len(good) == len(fair) == 20
    assert len(fair[0].colour) < len(good[0].colour)


def test_images_of_a_run_come_with_what_was_found(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        section = pack_images(run)
        taken = [at.time for at in run.events if at.record.kind == "image"]
    assert isinstance(section.data, Mapping)
    images = section.data["images"]
    assert isinstance(images, list)
    assert [image["time"] for image in images] == taken  # type: ignore[index, call-overload]
    assert section.data["note"] == ""
    assert len(images[0]["findings"]) == 4  # type: ignore[index, call-overload, arg-type]


def plot(values: np.ndarray) -> CurvePlot:
    times = np.linspace(0.0, 0.05 * len(values), len(values), dtype=np.float64)
    return CurvePlot("p", "P", "N", 0.01, times, (PlotCurve("x", values),))


def test_a_run_has_plots_of_joints_tracking_wrench_and_gripper(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        plots = {one.name: one for one in plots_of(run)}
        assert {
            name: (one.unit, [curve.label for curve in one.curves]) for name, one in plots.items()
        } == {
            "position": ("rad", ["j1", "j2", "j3", "j4", "j5", "j6", "j7"]),
            "velocity": ("rad/s", ["j1", "j2", "j3", "j4", "j5", "j6", "j7"]),
            "tracking": ("mrad", ["j1", "j2", "j3", "j4", "j5", "j6", "j7"]),
            "force": ("N", ["x", "y", "z", "size"]),
            "torque": ("Nm", ["x", "y", "z"]),
            "width": ("mm", ["width"]),
            "grip": ("N", ["force"]),
        }  # fmt: skip
        fingers = run.joints.positions[:, 7:].sum(axis=1)
        np.testing.assert_allclose(plots["width"].curves[0].values, 1000 * fingers)
        assert plots["width"].curves[0].values.max() > 70
        told = run.controls.errors[:, 2]
        np.testing.assert_allclose(plots["tracking"].curves[2].values, 1000 * told)
        size = np.linalg.norm(run.wrenches.forces, axis=1)
        np.testing.assert_allclose(plots["force"].curves[3].values, size)


def test_a_log_without_readings_says_so(tmp_path: Path) -> None:
    with Run(record(tmp_path / "log.mcap", tree("Main"), 2, {})) as run:
        assert pack_plots(run).data == {"empty": "The log holds neither joints nor forces."}


def test_a_short_curve_stays_as_it_is() -> None:
    one = plot(np.sin(np.arange(100)))
    assert thin_plot(one, 100) is one


@given(st.lists(st.floats(-1e3, 1e3) | st.just(float("nan")), min_size=11, max_size=300), st.integers(4, 10))
def test_thinning_keeps_every_extreme_in_its_place(values: list[float], most: int) -> None:
    full = np.array(values)
    few = thin_plot(plot(full), most)
    kept = few.curves[0].values
    assert len(kept) == len(few.times) <= most
    assert (np.diff(few.times) >= 0).all()
    if np.isnan(full).all():
        assert np.isnan(kept).all()
        return
    assert np.nanmax(kept) == np.nanmax(full)
    assert np.nanmin(kept) == np.nanmin(full)
    size = -(-len(full) // (most // 2))
    for k in range(0, len(kept), 2):
        stretch = full[k // 2 * size : (k // 2 + 1) * size]
        pair = kept[k : k + 2]
        if not np.isnan(stretch).all():
            assert sorted(pair) == [np.nanmin(stretch), np.nanmax(stretch)]
    assert few.note == f"Each point shows the least and the greatest value of {size} ticks."
