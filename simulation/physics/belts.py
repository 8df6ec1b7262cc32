"""Belts in pybullet: a moving surface below the items carries them by friction alone.

The engine has no surface that moves while its body stays. So a running belt is a slab on a prismatic joint
with a motor. After each centimetre of travel it is set back by as much, and its velocity is kept. The slab is
uniform, so it touches the items as before. A belt at rest is a static body and the slab touches nothing:
items on the belt sleep, and the robot feels a table.

The feed's access to the cell is here, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from picktree.simulation import BeltDrive, BeltState, LightCurtain, SpawnedItem, TrueBody, Zone, check_belts
from picktree.world import Box, ObjectId
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import Belt, Fixture, SceneDescription

from .bodies import STATIC_BODY_FRICTION
from .devices import EVERYDAY_PERIOD, IdealSensors
from .engine import pb
from .items import PhysicsItems

SLAB_SET_BACK = 0.01
"""Travel after which the slab is set back, m. Its ends are off the belt's by half of that at most."""
SLAB_MASS = 50.0
"""Mass of the slab, kg: large, so that items on it do not brake it."""
MAX_MOTOR_FORCE = 500.0
"""Greatest force of the slab's motor, N."""
STATIC_COLLISION_FILTER, NO_COLLISION_FILTER = (2, -3), (0, 0)
"""Collision group and mask of static bodies, and of bodies that touch nothing. Two bodies collide when either
of them wants to."""
SLAB_LINK = 0
"""Link index of the slab in its body."""


class PhysicsBelt(BeltDrive):
    """One belt in one pybullet client; `build` rebuilds its slab after a reset of the simulation."""

    def __init__(self, belt: Belt, fixture: Fixture, client: int) -> None:
        super().__init__(belt, fixture)
        self._fixture = fixture
        self._client = client
        self._still = self.slab = -1
        self._driven = False

    @property
    def driven(self) -> bool:
        """Whether the slab carries the items on the belt."""
        return self._driven

    def build(self, still: int) -> int:
        """Add the slab at the place of the static body `still`; return the slab's body number."""
        shape, client = self._fixture.shape, self._client
        assert isinstance(shape, Box)
        box = pb.createCollisionShape(
            pb.GEOM_BOX, halfExtents=[s / 2 for s in shape.size], physicsClientId=client
        )
        self.slab = pb.createMultiBody(
            0.0,
            -1,
            -1,
            self._fixture.pose.position,
            self._fixture.pose.orientation,
            linkMasses=[SLAB_MASS],
            linkCollisionShapeIndices=[box],
            linkVisualShapeIndices=[-1],
            linkPositions=[(0.0, 0.0, 0.0)],
            linkOrientations=[(0.0, 0.0, 0.0, 1.0)],
            linkInertialFramePositions=[(0.0, 0.0, 0.0)],
            linkInertialFrameOrientations=[(0.0, 0.0, 0.0, 1.0)],
            linkParentIndices=[0],
            linkJointTypes=[pb.JOINT_PRISMATIC],
            linkJointAxis=[(1.0, 0.0, 0.0)],
            physicsClientId=client,
        )
        pb.changeDynamics(
            self.slab,
            SLAB_LINK,
            lateralFriction=STATIC_BODY_FRICTION,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            jointLowerLimit=-1.0,
            jointUpperLimit=1.0,
            physicsClientId=client,
        )
        # An idle slab must be awake when it begins to carry: else items fall for a step.
        pb.changeDynamics(
            self.slab,
            -1,
            activationState=pb.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=client,
        )
        pb.changeVisualShape(self.slab, SLAB_LINK, rgbaColor=(1.0, 1.0, 1.0, 0.0), physicsClientId=client)
        self._still = still
        self.state = BeltState(self.belt.id)
        self._drive(on=False)
        return self.slab

    def restore(self, state: BeltState) -> None:
        self.state = state
        self._drive(on=state.moving)
        pb.resetJointState(self.slab, SLAB_LINK, state.offset, state.speed, physicsClientId=self._client)

    def before_step(self, period: float) -> None:
        if not self.state.moving:
            return
        if not self._driven:
            self._drive(on=True)
        self.state = self.state.after(self.belt.speed, period)
        self._motor(self.state.speed)

    def after_step(self) -> None:
        if not self._driven:
            return
        offset, velocity, *_ = pb.getJointState(self.slab, SLAB_LINK, self._client)
        if offset > SLAB_SET_BACK / 2:
            offset -= SLAB_SET_BACK
            pb.resetJointState(self.slab, SLAB_LINK, offset, velocity, physicsClientId=self._client)
        self.state = replace(self.state, offset=offset)
        if not self.state.moving:
            self._brake()

    def interrupted(self) -> bool:
        one, other = self.track.beam(self.belt.eye)
        ((body, *_),) = pb.rayTest(one, other, physicsClientId=self._client)
        return body != -1

    def _brake(self) -> None:
        """Set the slab's velocity to zero: the motor has stopped it but for the solver's residual."""
        pb.resetJointState(self.slab, SLAB_LINK, self.state.offset, 0.0, physicsClientId=self._client)
        self._drive(on=False)

    def _drive(self, *, on: bool) -> None:
        """Let the slab carry the items (`on`), or the static body."""
        self._driven = on
        self._motor(self.state.speed)
        carrying, idle = (self.slab, SLAB_LINK), (self._still, -1)
        if not on:
            carrying, idle = idle, carrying
        pb.setCollisionFilterGroupMask(*idle, *NO_COLLISION_FILTER, physicsClientId=self._client)
        pb.setCollisionFilterGroupMask(*carrying, *STATIC_COLLISION_FILTER, physicsClientId=self._client)

    def _motor(self, speed: float) -> None:
        pb.setJointMotorControl2(
            self.slab,
            SLAB_LINK,
            pb.VELOCITY_CONTROL,
            targetVelocity=speed,
            force=MAX_MOTOR_FORCE,
            physicsClientId=self._client,
        )


class PhysicsBelts:
    """All belts of a scene in one pybullet client."""

    def __init__(self, scene: SceneDescription, client: int) -> None:
        self.drives: Mapping[ObjectId, PhysicsBelt] = MappingProxyType(
            {b.id: PhysicsBelt(b, scene.fixture(b.id), client) for b in scene.belts}
        )

    def build(self, fixed: dict[int, str]) -> None:
        """Add the slabs and note their body numbers next to those of the static bodies."""
        still = {name: body for body, name in fixed.items()}
        for name, belt in self.drives.items():
            fixed[belt.build(still[name])] = name

    def running(self) -> frozenset[int]:
        """Return the body numbers of the slabs that move now."""
        return frozenset(belt.slab for belt in self.drives.values() if belt.driven)

    def before_step(self, period: float) -> None:
        """Command the motors for a step of `period` s."""
        for belt in self.drives.values():
            belt.before_step(period)

    def after_step(self) -> None:
        for belt in self.drives.values():
            belt.after_step()

    def states(self) -> tuple[BeltState, ...]:
        return tuple(belt.state for belt in self.drives.values())

    def restore(self, saved: Sequence[BeltState]) -> None:
        """Restore the belts' states. Raises PicktreeError when they are of other belts."""
        check_belts(saved, self.drives)
        for state in saved:
            self.drives[state.id].restore(state)


class PhysicsCell:
    """`FeedCell` of the physics backend."""

    def __init__(self, robot: RobotDescription, items: PhysicsItems, senses: IdealSensors) -> None:
        self._items = items
        self._senses = senses
        self._joints = len(robot.joints)
        self._curtain = LightCurtain(RobotModel(robot))

    @property
    def now(self) -> float:
        return self._senses.now

    @property
    def period(self) -> float:
        return EVERYDAY_PERIOD

    def here(self) -> tuple[TrueBody, ...]:
        return self._items.here()

    def next_id(self) -> ObjectId:
        return self._items.inventory.next_id()

    def put(self, item: SpawnedItem) -> None:
        self._items.put(item)

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        return self._items.at_rest(items)

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        self._items.take_with(bin_id, items)

    def arm_over(self, zone: Zone) -> bool:
        """Return whether any part of the arm is over the zone, by the true joint positions."""
        position = self._senses.reading.position
        arm, fingers = position[: self._joints], position[self._joints :]
        return self._curtain.crossed(zone, np.array(arm), sum(fingers))
