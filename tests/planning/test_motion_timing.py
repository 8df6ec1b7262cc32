"""From paths to motions: smooth curves, the fastest profile, and limits that hold at every sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from picktree.robot.planning import Scaling, time_corners, time_smooth
from picktree.robot.planning.path_curves import (
    JointCurve,
    blend_curves,
    concatenate,
    rounded_polyline,
    spline_through,
)
from picktree.robot.planning.time_parameterization import (
    ACCELERATION_RISE_TIME,
    TORQUE_LIMIT_SHARE,
    ScaledStretch,
    TimeLaw,
    time_curve,
)
from picktree.world import Array, Trajectory

from .motion_cell import HOME, MODEL

seeds = st.integers(0, 10**6)


def points(seed: int, count: int, spread: float = 0.5) -> Array:
    rng = np.random.default_rng(seed)
    return np.clip(HOME + rng.normal(size=(count, 7)) * spread, MODEL.planned_lower, MODEL.planned_upper)


def keeps_all_limits(trajectory: Trajectory, scaling: Scaling) -> None:
    """Velocity, acceleration, jerk and torque, from the samples and their differences."""
    t, more = trajectory, 1 + 1e-9
    dt = np.diff(t.times)[:, None]
    velocity = MODEL.velocity_limit * scaling.velocity
    acceleration = MODEL.acceleration_limit * scaling.acceleration
    assert (np.abs(t.velocity) <= velocity * more).all()
    assert (np.abs(t.acceleration) <= acceleration * more).all()
    assert (np.abs(np.diff(t.velocity, axis=0)) <= acceleration * dt * more).all()
    assert (
        np.abs(np.diff(t.acceleration, axis=0))
        <= MODEL.acceleration_limit / ACCELERATION_RISE_TIME * dt * more
    ).all()
    for ends in (t.velocity, t.acceleration):
        assert not ends[0].any() and not ends[-1].any()
    still = np.zeros(7)
    for q, v, a in list(zip(t.position, t.velocity, t.acceleration, strict=True))[::6]:
        weight = MODEL.inverse_dynamics(q, still, still)
        moving = np.abs(MODEL.inverse_dynamics(q, v, a) - weight)
        left = np.maximum(TORQUE_LIMIT_SHARE * MODEL.torque_limit - np.abs(weight), 0.1 * MODEL.torque_limit)
        assert (moving <= left * more).all()


def is_what_it_says(trajectory: Trajectory) -> None:
    """Velocities and accelerations are the derivatives of the positions, as near as the jerk allows."""
    t, jerk = trajectory, MODEL.acceleration_limit / ACCELERATION_RISE_TIME
    dt = np.diff(t.times)[:, None]
    mean = [(rows[1:] + rows[:-1]) / 2 * dt for rows in (t.velocity, t.acceleration)]
    bend = np.diff(t.acceleration, axis=0) * dt**2 / 12
    assert (np.abs(np.diff(t.velocity, axis=0) - mean[1]) <= jerk * dt**2 / 4 + 1e-9).all()
    assert (np.abs(np.diff(t.position, axis=0) - mean[0] + bend) <= jerk * dt**3 / 12 + 1e-9).all()


@settings(max_examples=15)
@given(
    seed=seeds,
    count=st.integers(2, 6),
    radius=st.sampled_from([0.1, 0.05, 0.005]),
    share=st.sampled_from([0.1, 0.5, 1.0]),
)
def test_random_corners_keep_all_limits(seed: int, count: int, radius: float, share: float) -> None:
    path = points(seed, count)
    scaling = Scaling(share, 1.0 - share / 2)
    trajectory = time_corners(MODEL, path, scaling, radius)
    assert trajectory is not None
    keeps_all_limits(trajectory, scaling)
    is_what_it_says(trajectory)
    assert np.array_equal(trajectory.start, path[0])
    assert np.abs(trajectory.end - path[-1]).max() < 1e-9
    assert (trajectory.position >= MODEL.lower).all() and (trajectory.position <= MODEL.upper).all()


@settings(max_examples=8)
@given(seed=seeds, share=st.sampled_from([0.1, 0.5, 1.0]))
def test_random_splines_keep_all_limits(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, 25)[:, None]
    path = HOME + s * rng.normal(size=7) * 0.3 + np.sin(3 * s) * rng.normal(size=7) * 0.1
    trajectory = time_smooth(MODEL, path, Scaling(share, share))
    assert trajectory is not None
    keeps_all_limits(trajectory, Scaling(share, share))
    is_what_it_says(trajectory)


@settings(max_examples=10)
@given(seed=seeds, scale=st.floats(-5.0, -2.0), count=st.integers(2, 4))
def test_the_smallest_motions_are_timed(seed: int, scale: float, count: int) -> None:
    path = HOME + np.random.default_rng(seed).normal(size=(count, 7)) * 10**scale
    trajectory = time_corners(MODEL, path, Scaling(), 0.1)
    assert trajectory is not None
    keeps_all_limits(trajectory, Scaling())
    assert np.abs(trajectory.end - path[-1]).max() < 1e-9


def test_each_stretch_keeps_its_own_scaling() -> None:
    curve = rounded_polyline(points(3, 5), 0.1)
    third = curve.length / 3
    stretches = [
        ScaledStretch(third, Scaling()),
        ScaledStretch(2 * third, Scaling(0.2, 0.3)),
        ScaledStretch(curve.length, Scaling(0.6, 1.0)),
    ]
    timed = time_curve(MODEL, curve, stretches)
    assert timed is not None
    keeps_all_limits(timed.trajectory, Scaling())
    begin = 0.0
    for stretch in stretches:
        inside = (timed.parameter > begin) & (timed.parameter < stretch.end)
        velocity = np.abs(timed.trajectory.velocity[inside]) / MODEL.velocity_limit
        acceleration = np.abs(timed.trajectory.acceleration[inside]) / MODEL.acceleration_limit
        assert velocity.max() <= stretch.scaling.velocity * (1 + 1e-9)
        assert acceleration.max() <= stretch.scaling.acceleration * (1 + 1e-9)
        assert velocity.max() > 0.8 * stretch.scaling.velocity
        begin = stretch.end
    assert timed.when(third) == pytest.approx(
        float(np.interp(third, timed.parameter, timed.trajectory.times))
    )


def derivatives_agree(curve: JointCurve, orders: int = 3) -> None:
    """At every break the curve's value and first derivatives are the same from both sides."""
    inner = curve.breaks[1:-1]
    for order in range(orders):
        jump = curve.at(inner + 1e-10, order) - curve.at(inner - 1e-10, order)
        assert np.abs(jump).max() < 1e-5 * 10**order


def test_corners_are_smooth_and_stay_within_their_triangles() -> None:
    path = points(5, 5)
    curve = rounded_polyline(path, 0.1)
    derivatives_agree(curve)
    assert (curve.at(np.linspace(0, curve.length, 500)) <= path.max(axis=0) + 1e-12).all()
    assert np.abs(curve.at(0.0) - path[0]).max() < 1e-12
    assert np.abs(curve.at(curve.length) - path[-1]).max() < 1e-12


def test_a_spline_is_the_natural_one() -> None:
    path = points(7, 9, 0.05)
    curve = spline_through(path)
    reference = CubicSpline(curve.breaks, path, bc_type="natural")
    s = np.linspace(0.0, curve.length, 200)
    for order in range(3):
        np.testing.assert_allclose(curve.at(s, order), reference(s, order), atol=1e-9)
    three = spline_through(path[:3])
    np.testing.assert_allclose(three.at(three.breaks), path[:3], atol=1e-12)


def test_a_piece_that_begins_at_a_break_but_for_rounding_begins_with_the_next_one() -> None:
    curve = spline_through(points(3, 6))
    for low in (np.nextafter(curve.breaks[2], 0.0), curve.breaks[2], np.nextafter(curve.breaks[2], 9.0)):
        part = curve.piece(float(low), curve.length)
        s = np.linspace(0.0, part.length, 50)
        np.testing.assert_allclose(part.at(s), curve.at(s + low), atol=1e-9)


def test_the_tool_keeps_its_greatest_acceleration() -> None:
    path = points(5, 3)
    accelerations: list[float] = []
    for tool in (np.inf, 2.0):
        timed = time_corners(MODEL, path, Scaling(tool=tool), 0.1)
        assert timed is not None
        # The middle of each second difference of places, without the two ends.
        at = np.arange(0.0, timed.duration, 0.005)
        places = MODEL.tcp_positions(np.array([timed.sample(t)[0] for t in at.tolist()]))
        pull = np.linalg.norm(np.diff(places, 2, axis=0), axis=1) / 0.005**2
        accelerations.append(float(pull[1:-1].max()))
    assert accelerations[0] > 3.0
    assert 1.5 < accelerations[1] <= 2.0 * 1.05


def test_pieces_and_bridges_fit_together() -> None:
    first, second = rounded_polyline(points(1, 3), 0.1), spline_through(points(2, 9, 0.05) + 0.1)
    radius = 0.04
    part = second.piece(0.02, second.length - 0.03)
    s = np.linspace(0.0, part.length, 50)
    np.testing.assert_allclose(part.at(s), second.at(s + 0.02), atol=1e-12)
    moved = JointCurve(second.breaks, second.coefficients.copy())
    moved.coefficients[:, 0] += first.at(first.length) - second.at(0.0)
    whole = concatenate(
        [
            first.piece(0.0, first.length - radius),
            blend_curves(first, moved, radius),
            moved.piece(radius, moved.length),
        ]
    )
    assert whole.length == pytest.approx(first.length + moved.length)
    derivatives_agree(whole)


def test_an_averaged_law_is_the_mean_over_its_window() -> None:
    law = TimeLaw(
        np.array([0.0, 0.3, 0.5, 0.8]), np.array([0.0, 0.15, 0.35, 0.5]), np.array([0.0, 1.0, 1.0, 0.0])
    )
    window = 0.1
    times = np.linspace(0.0, 0.9, 91)
    s, ds, dds = law.averaged(times, window)
    fine = np.linspace(-0.2, 1.0, 120001)
    exact = np.interp(fine, law.times, law.parameter)
    rising, falling = fine < 0.3, fine > 0.5
    exact = np.where(rising & (fine > 0), 0.5 * fine**2 / 0.3, exact)
    exact = np.where(falling & (fine < 0.8), 0.5 - 0.5 * (0.8 - fine) ** 2 / 0.3, exact)
    means = [exact[(fine > t - window) & (fine <= t)].mean() for t in times]
    np.testing.assert_allclose(s, means, atol=1e-4)
    np.testing.assert_allclose(np.gradient(s, times)[1:-1], ds[1:-1], atol=1e-2)
    assert s[0] == 0.0 and s[-1] == pytest.approx(0.5) and abs(ds[-1]) < 1e-12
    assert np.abs(np.diff(dds)).max() <= (1.0 / 0.3) / window * 0.01 * (1 + 1e-6)


def test_between_samples_position_velocity_and_acceleration_are_continuous() -> None:
    trajectory = time_corners(MODEL, points(11, 4), Scaling(), 0.1)
    assert trajectory is not None
    c = trajectory.polynomials()
    h = np.diff(trajectory.times)[:, None]
    powers = [h**k for k in range(6)]
    ends = [
        sum(c[:, k] * powers[k] for k in range(6)),
        sum(k * c[:, k] * powers[k - 1] for k in range(1, 6)),
        sum(k * (k - 1) * c[:, k] * powers[k - 2] for k in range(2, 6)),
    ]
    for end, rows in zip(
        ends, (trajectory.position, trajectory.velocity, trajectory.acceleration), strict=True
    ):
        np.testing.assert_allclose(end, rows[1:], atol=1e-7)
    middle = float(trajectory.times[20] + trajectory.times[21]) / 2
    position, velocity = trajectory.sample(middle)
    later, _ = trajectory.sample(middle + 1e-6)
    np.testing.assert_allclose((later - position) / 1e-6, velocity, atol=1e-4)
