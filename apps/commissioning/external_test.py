"""Test of a robot in another process: weight of the hand, noise, signs, a small motion, latency, gripper.

It is the first thing to run on a robot. The arm moves by millimetres about its present configuration,
slowly; the fingers close and open. What it measures is what the checks of a run rely on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from picktree.drivers import ExternalHardware, RobotMeasurement, measurement_path, write_measurement
from picktree.world import GRAVITY, Array, GripperCommand
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import load_scene

from .model_checks import Verdict
from .robot_test import RobotTestResult

REST_TIME: Final = 1.0
"""Time over which readings at rest are taken, s."""
STEP_LENGTH: Final = 0.005
"""Way of the tool along each axis, m."""
STEP_TIME: Final = 1.0
"""Duration of a small motion, s."""
TILT: Final = 0.3
"""Rotation of the last two joints for the weight of the hand, rad."""
MAX_MASS_ERROR: Final = 0.05
"""Greatest share by which the hand's mass may differ from the model: 5 % of 1 kg moves like 50 g in the
hand."""
MAX_BIAS: Final = 12.0
"""Greatest bias of the force, N."""
MAX_FORCE_NOISE: Final = 1.0
"""Greatest noise of the force with which missions were run, N."""
MAX_LATENCY: Final = 0.04
"""Greatest latency with which missions were run, s."""
MAX_GRIPPER_LATENCY: Final = 0.25
"""Greatest latency of the gripper with which missions were run, s."""
MAX_WEIGHT_RESIDUAL: Final = 0.5
"""Greatest force that weight and bias leave unexplained, N: more shows wrong axes."""
MAX_STEP_ERROR: Final = 5e-4
"""Greatest error of a small motion, m."""
START_WIDTH_CHANGE: Final = 5e-4
"""Change of the opening that shows that the fingers move, m."""


class _Bench:
    """Robot, its model, and the means to let time pass."""

    def __init__(self, hardware: ExternalHardware, model: RobotModel) -> None:
        self.hardware, self.model = hardware, model
        self.at: Array = hardware.joints.position.copy()
        """Commanded configuration (n,), rad."""
        told = hardware.link.robot
        self.measured = RobotMeasurement(
            told.robot, told.engine, 0.0, 0.0, 0.0, 0.0, True, None, None, model.hand_mass
        )
        """What was measured so far."""
        self.refused: list[str] = []
        """Wrong signs and frames, with which no mission is run."""

    def hold(self, seconds: float, watch: Callable[[], None] = lambda: None) -> None:
        """Hold the arm for some time; `watch` is called after each period."""
        for _ in range(round(seconds / self.hardware.period)):
            self.hardware.arm.follow(self.at, np.zeros_like(self.at))
            self.hardware.step()
            watch()

    def go(self, to: Array, seconds: float = STEP_TIME, watch: Callable[[], None] = lambda: None) -> None:
        """Move the arm to a configuration (n,) from rest to rest."""
        begin, way = self.at, to - self.at
        periods = round(seconds / self.hardware.period)
        for k in range(1, periods + 1):
            x = k / periods
            self.at = begin + (10 * x**3 - 15 * x**4 + 6 * x**5) * way
            rate = (30 * x**2 - 60 * x**3 + 30 * x**4) / seconds * way
            self.hardware.arm.follow(self.at, rate)
            self.hardware.step()
            watch()
        self.hold(0.3, watch)


def test_external_robot(name: str, scene: str, address: str) -> RobotTestResult:
    """Test the robot that listens at an address, and write what runs rely on, see `drivers.measurement`.

    Raises PicktreeError when it cannot be reached, is not the robot of the file, or stops by itself.
    """
    description, robot = load_scene(scene, Path.cwd()), load_robot(name, Path.cwd())
    hardware = ExternalHardware(description, robot, address)
    try:
        bench = _Bench(hardware, RobotModel(replace(robot, tool=description.tool)))
        bench.hold(0.2)
        verdicts = (
            _noise(bench),
            *_weight(bench),
            _small_motions(bench),
            _effort(bench),
            *_latencies(bench),
            *_gripper(bench),
        )
    finally:
        hardware.close()
    write_measurement(replace(bench.measured, refused=tuple(bench.refused)), measurement_path(robot))
    return RobotTestResult(f"{robot.name} at {address}", robot.source, verdicts)


def _noise(bench: _Bench) -> Verdict:
    """Measure the noise of wrist and encoders at rest."""
    forces: list[tuple[float, ...]] = []
    joints: list[Array] = []

    def read() -> None:
        forces.append(bench.hardware.state.wrench[:3])
        joints.append(bench.hardware.joints.position)

    bench.hold(REST_TIME, read)
    force, encoder = float(np.std(forces, axis=0).max()), float(np.std(joints, axis=0).max())
    bench.measured = replace(bench.measured, wrench_noise=force, encoder_noise=encoder)
    return Verdict(
        "noise at rest",
        force <= MAX_FORCE_NOISE,
        f"{force:.2f} N at the wrist, {1000 * encoder:.3f} mrad at the joints",
        "" if force <= MAX_FORCE_NOISE else f"filter the wrist sensor to {MAX_FORCE_NOISE:g} N",
    )


def _weight(bench: _Bench) -> tuple[Verdict, ...]:
    """Weigh the hand in four orientations: weight, bias, and what both leave unexplained."""
    begin, rows, values = bench.at.copy(), list[Array](), list[Array]()
    for last, tilt in ((0.0, 0.0), (TILT, TILT), (-TILT, -TILT), (TILT, -TILT)):
        to = begin.copy()
        to[-1] += last
        to[-2] += tilt
        bench.go(to)
        read: list[tuple[float, ...]] = []
        bench.hold(0.3, lambda read=read: read.append(bench.hardware.state.wrench[:3]))
        turn = bench.model.flange(bench.hardware.joints.position).rotation()
        down = turn.T @ np.array([0.0, 0.0, -GRAVITY])
        rows.append(np.hstack([down[:, None], np.eye(3)]))
        values.append(np.mean(read, axis=0))
    bench.go(begin)
    table, felt = np.vstack(rows), np.concatenate(values)
    fitted = np.linalg.lstsq(table, felt, rcond=None)[0]
    mass, bias = float(fitted[0]), float(np.linalg.norm(fitted[1:]))
    left = float(np.abs(table @ fitted - felt).max())
    known = bench.model.hand_mass
    fits = abs(mass / known - 1.0) <= MAX_MASS_ERROR
    change = ""
    bench.measured = replace(bench.measured, hand_mass=mass)
    if mass < 0.0:
        change = "the force has the wrong sign: send what hand and load exert on the wrist"
        bench.refused.append(change)
    elif not fits:
        change = f"enter {mass:.3f} kg for the hand in the robot file, under inertias:"
    axes = left <= MAX_WEIGHT_RESIDUAL and bias <= MAX_BIAS
    turn_axes = "turn the force into the axes of the flange, and tare the sensor with a free hand"
    if not axes:
        bench.refused.append(turn_axes)
    return (
        Verdict("weight of the hand", fits, f"{mass:.3f} kg, by the model {known:.3f} kg", change),
        Verdict(
            "axes of the wrist",
            axes,
            f"{left:.2f} N unexplained, bias {bias:.1f} N",
            "" if axes else turn_axes,
        ),
    )


def _small_motions(bench: _Bench) -> Verdict:
    """Move the tool by 5 mm along each axis and back; compare the encoders with the command."""
    begin, worst = bench.at.copy(), 0.0
    start = np.array(bench.model.tcp(begin).position)
    for axis in np.eye(3):
        jacobian = bench.model.jacobian(begin)
        way = np.concatenate([axis * STEP_LENGTH, np.zeros(3)])
        bench.go(begin + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), way))
        there = np.array(bench.model.tcp(bench.hardware.joints.position).position)
        worst = max(worst, float(np.linalg.norm(there - start - axis * STEP_LENGTH)))
        bench.go(begin)
    good = worst <= MAX_STEP_ERROR
    compare = "compare order, signs and zeros of the joints with the robot file"
    if worst > STEP_LENGTH / 2:
        bench.refused.append(compare)
    return Verdict(
        "5 mm along x, y, z",
        good,
        f"at most {1000 * worst:.2f} mm off by the encoders",
        "" if good else compare,
    )


def _effort(bench: _Bench) -> Verdict:
    """Compare the efforts at rest with gravity; nothing depends on it."""
    joints = bench.hardware.joints
    off = np.abs(joints.effort - bench.model.gravity(joints.position))
    k = int(off.argmax())
    return Verdict(
        "effort at rest",
        True,
        f"{off[k]:.2f} Nm from the model's gravity at {bench.model.description.joints[k]} (not used)",
    )


def _latencies(bench: _Bench) -> tuple[Verdict, ...]:
    """Measure how late the joints show a motion, against the commanded one, by the best shift in time."""
    told: list[float] = []
    shown: list[float] = []

    def read() -> None:
        told.append(float(bench.at[-1]))
        shown.append(float(bench.hardware.joints.position[-1]))

    begin = bench.at.copy()
    to = begin.copy()
    to[-1] += 0.1
    bench.go(to, 0.5, read)
    bench.go(begin, 0.5, read)
    period, told_array, shown_array = bench.hardware.period, np.array(told), np.array(shown)
    errors = [float(np.square(shown_array[k:] - told_array[: len(told_array) - k]).mean()) for k in range(40)]
    whole, said = int(np.argmin(errors)) * period, bench.hardware.latency
    good = whole <= MAX_LATENCY + 0.02
    honest = abs(whole - said) <= 0.02
    bench.measured = replace(bench.measured, latency=whole, told_latency=said, honest=honest)
    return (
        Verdict(
            "latency of the arm",
            good,
            f"{1000 * whole:.0f} ms from a set-point to the encoders, the servo's own lag included",
            "" if good else f"contacts were tried with {1000 * MAX_LATENCY:.0f} ms at most",
        ),
        Verdict(
            "latency in the state",
            honest,
            f"{1000 * said:.0f} ms by stamps and sequence numbers",
            "" if honest else "let stamps and `command` of STATE tell how old both are",
        ),
    )


def _gripper(bench: _Bench) -> tuple[Verdict, ...]:
    """Close the free fingers halfway and open them: when they start, end, and what `busy` says."""
    hardware, limits = bench.hardware, bench.model.description.gripper
    begin, half = hardware.fingers.width, limits.max_width / 2
    hardware.gripper.command(GripperCommand(half, limits.max_force / 2))
    start = end = math.inf
    idle = False
    began = hardware.clock.now
    limit = half / (2 * limits.speed) + 2.0

    def read() -> None:
        nonlocal start, end, idle
        width, now = hardware.fingers.width, hardware.clock.now - began
        if abs(width - begin) > START_WIDTH_CHANGE:
            start = min(start, now)
        elif now > 0.1 and not hardware.fingers.busy:
            idle = True
        if abs(width - half) < 1.5e-3:
            end = min(end, now)

    bench.hold(limit, read)
    hardware.gripper.command(GripperCommand(begin, limits.max_force / 2))
    bench.hold(limit)
    moves = math.isfinite(end)
    bench.measured = replace(
        bench.measured,
        gripper_start=start if math.isfinite(start) else None,
        gripper_time=end if moves else None,
    )
    late = start > MAX_GRIPPER_LATENCY
    fits = not idle
    return (
        Verdict(
            "gripper",
            moves and not late,
            f"starts after {1000 * start:.0f} ms, half open after {1000 * end:.0f} ms"
            if moves
            else f"at {1000 * hardware.fingers.width:.1f} mm, told {1000 * half:.1f} mm",
            "" if moves and not late else "missions were tried with fingers that start within 250 ms",
        ),
        Verdict(
            "gripper is busy",
            fits,
            "from the command on" if fits else "not before it moves",
            "" if fits else "set `busy` of STATE as soon as a command has come",
        ),
    )
