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
        made = SimpleNamespace(control=control, robot=MODEL, tick=TICK, gripper=self.grip)
        made.clock, made.scene = SimpleNamespace(now=self.now), SimpleNamespace(held=None)
        made.description = SimpleNamespace(catalogue=())
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


@pytest.mark.parametrize(
    ("lift", "at_least", "at_most"),
    [(Lift(0.0), -0.02, 0.02), (Lift(0.5, slides=0.3), 0.3, 9.9), (Lift(0.1, turns=0.6), None, None)],
    ids=["an empty hand", "what was lost on the last centimetres", "a hand that turns"],
)
def test_what_is_not_surely_held_leaves_doubt(
    lift: Lift, at_least: float | None, at_most: float | None
) -> None:
    """Of what was lost late the mean over the whole lift is still heavy enough; what turns is not weighed."""
    weighing, doubt = lift.weigh()
    load = weighing.load()
    assert weighing.hold is None
    assert doubt is not None and doubt.cause is grasp.SLIPPED
    if at_least is None or at_most is None:
        assert load is None
    else:
        assert load is not None and at_least < load < at_most


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
