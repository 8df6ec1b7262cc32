"""Data of the plots: honest curves in few points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from picktree.analysis import Run
from picktree.analysis.report.sensor_panels import CurvePlot, PlotCurve, pack_plots, plots_of, thin_plot

from ..logs.scripted_log import record, tree


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
    assert few.note == f"Least and greatest of {size} ticks each."
