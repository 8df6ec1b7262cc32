"""The simulated wrist sensor: a bias that turns with the hand, drift, and what pushes one finger."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.simulation.sensor_noise import WrenchBiasNoise
from picktree.world import RandomStreams
from picktree.world.scene import SensorNoise

from ..manipulation.test_closing import INGOT, Bench

ROBOT_FINGERS = {"panda_leftfinger", "panda_rightfinger"}


def bias(seed: int, **noise: float) -> WrenchBiasNoise:
    return WrenchBiasNoise(SensorNoise(**noise), RandomStreams(seed))


def test_the_bias_follows_from_the_seed_and_wanders_slowly() -> None:
    one = bias(3)
    assert one.at(0.0).tolist() == bias(3).at(0.0).tolist()
    assert one.at(0.0).tolist() != bias(4).at(0.0).tolist()
    minutes = np.array([one.at(t) - one.at(0.0) for t in range(0, 600, 5)])
    assert 0.05 < np.abs(minutes[:, :3]).max() < 0.6
    assert np.abs(np.diff(minutes, axis=0)).max() < 0.1
    assert bias(3, drift=0.0).at(500.0).tolist() == bias(3, drift=0.0).at(0.0).tolist()


def test_biases_are_as_large_as_the_scene_says() -> None:
    drawn = np.array([bias(seed, force_bias=2.0, torque_bias=0.1).at(0.0) for seed in range(400)])
    assert drawn[:, :3].std() == pytest.approx(2.0, rel=0.1)
    assert drawn[:, 3:].std() == pytest.approx(0.1, rel=0.1)
    assert not bias(3, force_bias=0.0, torque_bias=0.0).any


def test_the_bias_turns_with_the_hand() -> None:
    one = bias(5)
    fx, fy, fz, tx, ty, tz = one.at(1.0).tolist()
    half = math.sqrt(0.5)
    assert one.in_world(1.0, (0.0, 0.0, half, half)) == pytest.approx((-fy, fx, fz, -ty, tx, tz))


def test_the_wrist_feels_what_pushes_one_finger() -> None:
    bench = Bench(INGOT, 0.006)
    q = bench.loop.state.position
    before = bench.loop.wrist.over(0.1, q)
    bench.run(bench.grip.close(3.0))
    for _ in range(4):
        bench.loop.step_tick(0.05)
    finger = ROBOT_FINGERS & bench.touching
    assert len(finger) == 1
    true = sum(c.force for c in bench.physics.true_contacts() if {c.one, c.other} & finger)
    assert true == pytest.approx(6.0, abs=0.3)
    felt = float(bench.axis @ (bench.loop.wrist.over(0.1, q) - before)[:3])
    assert abs(felt) == pytest.approx(true, rel=0.06)
