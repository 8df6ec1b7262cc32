"""Slip is felt as mass that is missing, also while the arm accelerates."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.robot.control import (
    MassEstimate,
    Payload,
    SlipDetector,
    WristSample,
    estimate_moving_mass,
    wrist_sample,
)
from picktree.world.robot_model import RobotModel, load_robot

MODEL = RobotModel(load_robot("panda"))
TICK = 0.05
CAN = Payload(0.12, 0.005)


@pytest.mark.parametrize("mass", [0.0, 0.05, 1.2])
def test_shaking_is_not_taken_for_slipping(mass: float) -> None:
    """Twelve ticks of a turn of several joints, the force by Newton's law at many times in each tick."""
    centre = np.array([0.005, 0.0, 0.02])
    joints = np.array([1.0, 0.4, 0.3, -0.2, 0.6, -0.4, 0.8])
    q0 = MODEL.named("home")

    def at(time: float) -> WristSample:
        q = q0 + joints * 0.15 * np.sin(8.0 * time)
        v = joints * 1.2 * np.cos(8.0 * time)
        return wrist_sample(MODEL, q, v, np.zeros(3), centre)

    def pull(time: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        one, other = at(time - 1e-4), at(time + 1e-4)
        hand, load = (other.hand - one.hand) / 2e-4, (other.load - one.load) / 2e-4
        return -MODEL.hand_mass * hand - mass * (load + np.array([0.0, 0.0, 9.81]))

    fastest = 0.0
    for k in range(12):
        times = (k + (np.arange(20) + 0.5) / 20) * TICK
        before, after = at(k * TICK), at((k + 1) * TICK)
        force = np.mean([pull(t) for t in times], axis=0)
        felt = estimate_moving_mass(MODEL.hand_mass, before, WristSample(force, after.hand, after.load), TICK)
        assert felt.mass == pytest.approx(mass, abs=0.002)
        fastest = max(fastest, float(np.linalg.norm((after.load - before.load) / TICK)))
    assert fastest > 4.0


def feel(detector: SlipDetector, *masses: float, unsure: float = 0.02) -> tuple[bool, bool]:
    for mass in masses:
        detector.feel(MassEstimate(mass, unsure))
    return detector.slipping, detector.gone


def test_one_tick_is_none_and_two_are_a_slip() -> None:
    detector = SlipDetector(CAN)
    assert feel(detector, 0.12, 0.06) == (False, False)
    assert feel(detector, 0.06) == (True, False)
    assert feel(detector, 0.01, 0.0) == (True, True)


def test_after_a_firmer_grip_it_is_judged_anew() -> None:
    detector = SlipDetector(CAN)
    assert feel(detector, 0.05, 0.05) == (True, False)
    detector.forget()
    assert feel(detector, 0.05) == (False, False)
    assert feel(detector, 0.11) == (False, False)


def test_what_is_shaken_too_hard_tells_nothing() -> None:
    detector = SlipDetector(CAN)
    assert feel(detector, 0.0, 0.0, 0.0, unsure=0.07) == (False, False)


def test_a_mass_that_is_only_believed_has_to_be_missed_clearly() -> None:
    vague = SlipDetector(Payload(0.12, 0.03))
    assert feel(vague, 0.05, 0.05) == (False, False)
    assert feel(SlipDetector(Payload(2.0, 0.5)), 0.4, 0.4) == (True, True)
