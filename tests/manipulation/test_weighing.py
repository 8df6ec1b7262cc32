"""Payload estimation while the arm lifts."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from picktree.robot import World
from picktree.robot.control import MassEstimate, Payload
from picktree.robot.manipulation.weighing import GripMonitor, LiftWeighing
from picktree.world import Array, Failure, grasp
from picktree.world.robot_model import RobotModel, load_robot

MODEL = RobotModel(load_robot("panda"))
TICK = 0.05
G = 9.81


@dataclass
class Lift:
    """A hand that is lifted by 8 cm in half a second, along a sine, with `mass` kg between its fingers."""

    mass: float
    slides: float | None = None
    """Time at which it is lost, s; the fingers stay as they are."""
    turns: float = 0.0
    """Angular speed of the hand during the lift, rad/s."""
    width: float = 0.04
    now: float = 0.0

    def __post_init__(self) -> None:
        self.home = MODEL.named("home")
        self.up = self.moving(self.home, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))

    @staticmethod
    def moving(q: Array, twist: Array) -> Array:
        """Joint speeds (n,) that move the TCP by a twist (6,)."""
        return np.asarray(np.linalg.pinv(MODEL.jacobian(q)) @ twist, np.float64)

    def speed(self, time: float) -> float:
        return 0.16 * (1.0 - np.cos(2 * np.pi * time / 0.5))

    def height(self, time: float) -> float:
        return 0.16 * (time - 0.5 / (2 * np.pi) * np.sin(2 * np.pi * time / 0.5))

    def load(self, window: float) -> float:
        """The mean force over the last tick, as an ideal wrist has it: by the change of momentum."""
        begin = self.now - TICK
        rising = (self.speed(self.now) - self.speed(begin)) / TICK
        held = self.mass if self.slides is None or begin < self.slides else 0.0
        return (MODEL.hand_mass + held) * rising + held * G

    def world(self) -> World:
        position = self.home + self.up * self.height(self.now)
        velocity = self.moving(position, np.array([0.0, 0.0, self.speed(self.now), 0.0, 0.0, self.turns]))
        control = SimpleNamespace(
            load=self.load,
            wrist=SimpleNamespace(payload=None),
            period=1 / 240,
            state=SimpleNamespace(position=position, velocity=velocity),
            tcp=MODEL.tcp(position),
        )
        self.grip = SimpleNamespace(width=self.width)
        clock = SimpleNamespace(now=self.now)
        made = SimpleNamespace(
            control=control,
            robot=MODEL,
            tick=TICK,
            clock=clock,
            gripper=self.grip,
            scene=SimpleNamespace(held=None),
            description=SimpleNamespace(catalogue=()),
        )
        return cast("World", made)

    def weigh(self) -> tuple[LiftWeighing, Failure | None]:
        """Lift it, asking each tick, until a failure stops the arm."""
        world = self.world()
        weighing, doubt = LiftWeighing(world, 0.5), None
        while self.now < 0.5 - 1e-9 and doubt is None:
            self.now += TICK
            later = self.world()
            world.__dict__.update(control=later.control, clock=later.clock, gripper=self.grip)
            doubt = weighing.watch()
        return weighing, doubt


@pytest.mark.parametrize("mass", [0.03, 0.1, 1.0])
def test_it_weighs_what_it_weighs_although_the_hand_is_accelerated(mass: float) -> None:
    weighing, doubt = Lift(mass).weigh()
    assert doubt is None
    assert weighing.hold is not None
    assert weighing.hold.load == pytest.approx(mass * G, abs=0.02)


def test_an_empty_hand_leaves_doubt() -> None:
    weighing, doubt = Lift(0.0).weigh()
    assert weighing.hold is None
    assert doubt is not None and doubt.cause is grasp.SLIPPED
    assert abs(weighing.load() or 1.0) < 0.02


def test_what_was_lost_on_the_last_centimetres_leaves_doubt() -> None:
    """The mean over the whole lift is still heavy enough."""
    weighing, doubt = Lift(0.5, slides=0.3).weigh()
    assert (weighing.load() or 0.0) > 0.3
    assert weighing.hold is None
    assert doubt is not None and doubt.cause is grasp.SLIPPED


def test_a_hand_that_turns_is_not_weighed() -> None:
    weighing, doubt = Lift(0.1, turns=0.6).weigh()
    assert (weighing.load(), weighing.hold) == (None, None)
    assert doubt is not None and doubt.cause is grasp.SLIPPED


@pytest.mark.parametrize("width", [0.036, 0.044, 0.001])
def test_fingers_that_move_leave_doubt(width: float) -> None:
    world = Lift(0.1).world()
    kept = GripMonitor(world)
    assert kept.watch() is None
    world.gripper.__dict__["width"] = width
    doubt = kept.watch()
    assert doubt is not None and doubt.cause is grasp.SLIPPED


@pytest.mark.parametrize(
    ("felt", "weight"), [((0.09, 0.02), 0.1 * G), ((0.09, 0.08), None), ((0.01, 0.015), None), (None, None)]
)
def test_what_is_surely_felt_on_arrival_need_not_be_weighed_at_rest(
    felt: tuple[float, float] | None, weight: float | None
) -> None:
    world = Lift(0.1).world()
    world.control.wrist.__dict__["payload"] = Payload(0.1, 0.005)
    kept = GripMonitor(world)
    kept.felt = None if felt is None else MassEstimate(*felt)
    assert kept.weight == (None if weight is None else pytest.approx(weight))
