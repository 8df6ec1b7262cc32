"""Kinematic backend without physics: motions are exact, objects follow the gripper, sensors have no noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from picktree.files import PicktreeError
from picktree.simulation import (
    MIN_ITEM_CLEARANCE,
    MIN_OBSTACLE_CLEARANCE,
    BeltDrive,
    DeviceFaults,
    Feeder,
    FeederState,
    FreeSpaceCheck,
    HiddenObstacles,
    HoledFixtures,
    Inventory,
    SpawnedItem,
    TrueBody,
    TrueObstacle,
    checkpoints,
    displace_fixtures,
    enlarged_item,
    fault_entries,
    floor_height,
    has_feeder,
    jam_command,
    placed_item,
    spawn_items,
    walls,
)
from picktree.world import (
    GRAVITY,
    Camera,
    Feed,
    GripperCommand,
    JournalEvent,
    NoFeed,
    ObjectId,
    Pose,
    RandomStreams,
    SensorStamps,
    Shape,
    Vector3,
    scaled,
)
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import Fixture, SceneDescription

from .belts import KinematicBelts, KinematicCell, body_of, true_body
from .bodies import KinematicBodies, KinematicBody
from .camera import KinematicCamera, Posture, RenderStage
from .contact_forces import CONTACT_STIFFNESS, KinematicContactForces
from .devices import KinematicArm, KinematicClock, KinematicGripper, KinematicWrench


class KinematicHardware:
    """`protocols.Hardware` without physics, for dry runs and tests: fast, exact and deterministic."""

    def __init__(
        self, scene: SceneDescription, robot: RobotDescription, seed: int, period: float = 1 / 240
    ) -> None:
        self.scene = scene
        self.robot = robot
        self.seed = seed
        self.period = period
        self.model = RobotModel(robot)
        same = robot.tool == scene.tool
        self._believed = self.model if same else RobotModel(replace(robot, tool=scene.tool))
        self._real = real = displace_fixtures(scene, seed, level=True)
        if scene.heaped:
            raise PicktreeError(
                f"{scene.source or scene.name}: items are poured into a heap, which needs physics: "
                "without it nothing falls or leans; run it with '--backend physics'"
            )
        items = spawn_items(scene, seed)
        self._inventory = Inventory(scene, items)
        self._boards = HoledFixtures(real.fixtures)
        self.bodies = KinematicBodies(real, (body_of(item) for item in items))
        self._obstacles = HiddenObstacles(lambda _: self._restand(), lambda _: self._restand())
        self._obstacles.renew(scene.unknown)
        self._room: FreeSpaceCheck | None = None
        self.bodies.settle()
        floor = floor_height(scene.fixtures, robot.base_in_world.position[2])
        self._belts = KinematicBelts(scene, self.bodies, floor, period)
        self.clock = KinematicClock(period)
        self.faults = DeviceFaults(c.name for c in scene.cameras)
        self.arm = KinematicArm(self.model, period, self.faults)
        self.gripper = KinematicGripper(robot.gripper, self.bodies, self.faults)
        self.wrench = KinematicWrench(self.faults, lambda: self.model.flange(self.arm.position).orientation)
        self._streams = RandomStreams(seed)
        stage = RenderStage(real, robot, period)
        self.cameras: Mapping[str, Camera] = MappingProxyType(
            {
                c.name: KinematicCamera(
                    c,
                    stage,
                    self.bodies,
                    self.clock,
                    self._posture,
                    lambda: self._obstacles.here,
                    self.faults,
                    self._streams,
                )
                for c in scene.cameras
            }
        )
        self._feeder: Feeder | None = None
        if has_feeder(scene):
            cell = KinematicCell(self.model, self.bodies, self._inventory, self.clock, period, self._posture)
            self._feeder = Feeder(scene, cell, seed, self._belts.drives)
        self.feed: Feed = self._feeder or NoFeed()
        self.initial_truth = self.truth()
        """Ground truth at time 0."""
        self._lent: dict[ObjectId, tuple[float, float]] = {}
        """Items with a temporary friction: their own friction, and the one that a fault has set."""
        self._forces = KinematicContactForces(
            self.model, robot.gripper, self.arm, self.gripper, self.wrench, self.bodies, period
        )
        self._forces.sense()

    def step(self) -> None:
        self.arm.step(self._forces.on_tcp)
        self._belts.step()
        self.clock.periods += 1
        self._forces.sense()
        if self._feeder is not None:
            self._feeder.stepped(self.clock.periods)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events of the feed since the last call."""
        return self._feeder.take_events() if self._feeder is not None else ()

    def vary_noise(self, variant: int) -> None:
        """Draw the noise of the cameras' faults from that variant of their streams."""
        self._streams.variant = variant

    @classmethod
    def resume(
        cls,
        scene: SceneDescription,
        robot: RobotDescription,
        seed: int,
        checkpoint: checkpoints.KinematicState,
    ) -> KinematicHardware:
        """Build the hardware from a checkpoint, in this process or another."""
        hardware = cls(scene, robot, seed)
        hardware.restore(checkpoint)
        return hardware

    @property
    def belts(self) -> Mapping[ObjectId, BeltDrive]:
        """Belts by name, for the feed; the robot has no access."""
        return self._belts.drives

    takes_torque = True
    latency = 0.0
    preview = ()

    @property
    def feels_effort(self) -> bool:
        """Whether joint efforts are true while the arm moves: False. They are so at rest only, because the
        arm follows commands without effort."""
        return False

    @property
    def stamps(self) -> SensorStamps:
        now, silence = self.clock.now, self.faults.silence
        return SensorStamps(now, now, now if silence is None else silence.since)

    def pace(self, rate: int | None = None) -> None:
        """Do nothing: there is no solver that a finer step would help."""

    def settings(self) -> Mapping[str, str]:
        """Return the settings of this simulation for the record."""
        return {
            "engine": "kinematic",
            "period": f"{self.period:.6g} s",
            "contact": f"{CONTACT_STIFFNESS:g} N/m",
        }

    def close(self) -> None:
        """Do nothing: no resource needs an explicit release."""

    def truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of all items, for the scorer only; see `Inventory.truth`."""
        return self._inventory.truth(self._true)

    def recent_truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth for faults and the log; see `Inventory.recent_truth`."""
        return self._inventory.recent_truth(self._true)

    @property
    def item_count(self) -> int:
        """Number of items that ever came."""
        return self._inventory.count

    def _true(self, name: ObjectId) -> TrueBody:
        return self._seated(true_body(self.bodies[name], self._inventory))

    def true_fixtures(self) -> tuple[Fixture, ...]:
        """Return the scene's fixtures at their true poses."""
        return self._real.fixtures

    def _seated(self, body: TrueBody) -> TrueBody:
        """Return the body with its seating in a hole; no body is ever inside a wall here."""
        seat = self._boards.seat(body.shape, body.pose) if body.present else None
        return body if seat is None else replace(body, seat=seat)

    def true_tcp(self) -> Pose:
        """Return the true TCP pose in the world, for tests."""
        return self.model.tcp(self.arm.position)

    def remove(self, item: str) -> None:
        """Carry out a fault: remove the item, also from the hand."""
        self.bodies.remove(self._body(item).id)

    def change_dynamics(self, item: str, friction: float | None = None, mass: float | None = None) -> None:
        """Carry out a fault: change the item's friction, or its mass in kg, for good."""
        body = self._body(item)
        entry = body.entry if mass is None else replace(body.entry, mass=mass)
        self.bodies.put(replace(body, entry=entry, friction=body.friction if friction is None else friction))

    def friction_of(self, item: str) -> float:
        return self._body(item).friction

    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """Carry out a fault: the item slides from `velocity`, m/s, until friction has stopped it. A held item
        stays."""
        body = self._body(item)
        x, y, _ = velocity
        speed = math.hypot(x, y)
        if speed <= 0.0 or self.bodies.held == body.id:
            return
        way = speed**2 / (2.0 * max(body.friction, 0.05) * GRAVITY)
        self.bodies.put(replace(body, pose=body.pose.shifted((x / speed * way, y / speed * way, 0.0))))
        self.bodies.settle()

    def obstacles(self) -> tuple[TrueObstacle, ...]:
        """Return the obstacles that are unknown to the robot. The arm passes through them: only their tops
        are solid here."""
        return self._obstacles.truth()

    def room_for(self, body: Fixture) -> bool:
        """Return whether the body's place is free of items and robot."""
        return self._free(body.shape, body.pose, "", MIN_OBSTACLE_CLEARANCE)

    def _free(
        self, shape: Shape, pose: Pose, but: str, room: float, more: Iterable[tuple[Shape, Pose]] = ()
    ) -> bool:
        """Return whether a body fits between the robot, the items except `but`, and the bodies `more`."""
        self._room = self._room or FreeSpaceCheck(self.model)
        items = [(item.entry.shape, item.pose) for item in self.bodies.present if item.id != but]
        return self._room.free(shape, pose, [*items, *more], self.arm.position, self.gripper.width, room)

    def in_hand(self) -> ObjectId | None:
        """Return the item that the fingers hold; None: nothing."""
        return self.bodies.held

    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """Carry out a fault: set the item's friction; None: its own again. With too little friction it leaves
        the fingers."""
        name = ObjectId(item)
        if name not in self.bodies:
            self._lent.pop(name, None)
            return
        body = self.bodies[name]
        own = self._lent.pop(name, (body.friction, 0.0))[0]
        if friction is not None:
            self._lent[name] = own, friction
        self.bodies.put(replace(body, friction=own if friction is None else friction))

    def enlarge(self, item: str, factor: float) -> bool:
        """Carry out a fault: scale the item by `factor` with constant mass and friction. Returns False when
        it is held, or when items or robot leave no room."""
        body = self._body(item)
        entry, pose = enlarged_item(body.entry, body.pose, factor)
        if self.bodies.held == body.id or not self._free(entry.shape, pose, item, MIN_ITEM_CLEARANCE):
            return False
        self.bodies.put(replace(body, entry=entry, pose=pose, scale=body.scale * factor))
        self.bodies.settle()
        return True

    def appear(self, kind: str, colour: str, place: tuple[float, float], yaw: float) -> ObjectId | None:
        """Carry out a fault: add an item at `place`; None: something is there now. Raises PicktreeError where
        no fixture is below."""
        item = placed_item(self._real, self._inventory.next_id(), kind, colour, place, yaw)
        if not self._free(item.entry.shape, item.pose, "", MIN_ITEM_CLEARANCE, walls(self.scene)):
            return None
        self._inventory.add(item)
        self.bodies.put(body_of(item))
        self.bodies.drop(item.id)
        return item.id

    def afflict(
        self, number: int, fault: fault_entries.LastingFault, held: tuple[float, ...] | None = None
    ) -> None:
        """Begin a fault of a device. `held` is given on restore: the device's state when the fault began."""
        self.faults.begin(number, fault, self._doing(fault) if held is None else held)
        if isinstance(fault, fault_entries.Stall) and held is None:
            self.arm.hold()

    def relieve(self, number: int) -> None:
        """End a fault of a device."""
        self.faults.end(number)

    def _doing(self, fault: fault_entries.LastingFault) -> tuple[float, ...]:
        """Return the present state of the device that a fault affects, as `DeviceFaults` keeps it."""
        match fault:
            case fault_entries.GripperJam():
                command = GripperCommand(self.gripper.target, self.gripper.force)
                return jam_command(command, self.gripper.width, self.robot.gripper.max_force)
            case fault_entries.WrenchDead():
                reading = self.wrench.read()
                return (*reading.force, *reading.torque, self.stamps.wrench)
            case _:
                return (0.0,) if fault_entries.counted(fault) else ()

    def put_obstacle(self, body: Fixture) -> ObjectId:
        """Carry out a fault: add an obstacle and return its name."""
        return self._obstacles.put(body)

    def take_obstacle(self, name: ObjectId) -> None:
        """Remove an obstacle that a fault has added."""
        self._obstacles.take(name)

    def _restand(self) -> None:
        self.bodies.replace_obstacles(self._obstacles.here)

    def checkpoint(self) -> checkpoints.KinematicState:
        """Save the state and continue from it, as a resumed run would."""
        saved = self.snapshot()
        self.restore(saved)
        return saved

    def snapshot(self) -> checkpoints.KinematicState:
        """Return the state at any moment, without side effects."""
        gripper, bodies = self.gripper, self.bodies
        return checkpoints.KinematicState(
            self.seed,
            self.clock.periods,
            tuple(self.arm.position.tolist()),
            tuple(self.arm.velocity.tolist()),
            gripper.width,
            gripper.target,
            gripper.force,
            gripper.gripped,
            gripper.item_in_tcp,
            bodies.held,
            tuple(self._item_state(body) for body in bodies.items),
            self._belts.states(),
            self._inventory.state(),
            self._feeder.state() if self._feeder is not None else None,
            self._obstacles.here,
        )

    def restore(self, saved: checkpoints.KinematicState) -> None:
        """Restore a checkpoint of the same scene, robot and seed, taken with the arm at rest. Raises
        PicktreeError when seed or items differ."""
        if saved.seed != self.seed:
            raise PicktreeError(f"the checkpoint is of seed {saved.seed}, but this run has seed {self.seed}")
        self._inventory.restore(saved.inventory)
        known = self._inventory.here
        if [item.id for item in saved.items] != list(known):
            raise PicktreeError("the checkpoint's items are not those that the scene spawns")
        self.clock.periods = saved.periods
        self.arm.set(np.array(saved.position), np.array(saved.velocity))
        gripper = self.gripper
        gripper.width, gripper.target, gripper.force = saved.width, saved.target, saved.force
        gripper.gripped, gripper.item_in_tcp, gripper.speed = saved.gripped, saved.item_in_tcp, 0.0
        self._obstacles.renew(self.scene.unknown if saved.obstacles is None else saved.obstacles)
        self._restand()
        self.bodies.replace_all((_restored_body(known[item.id], item) for item in saved.items), saved.held)
        for name, (_, friction) in self._lent.items():
            if name in self.bodies:
                self.bodies.put(replace(self.bodies[name], friction=friction))
        self._belts.restore(saved.belts)
        if self._feeder is not None:
            self._feeder.restore(saved.feeder or FeederState())
        self._forces.forget()
        self._forces.sense(still=True)

    def _item_state(self, body: KinematicBody) -> checkpoints.ItemState:
        """Return the item's state with its own friction, not a temporary one."""
        own = self._lent.get(body.id, (body.friction, 0.0))[0]
        return checkpoints.ItemState(body.id, body.pose, own, body.entry.mass, body.present, body.scale)

    def _body(self, item: str) -> KinematicBody:
        if self._inventory.has_left(item):
            raise PicktreeError(f"item {item!r} was taken away before")
        if item not in self.bodies:
            known = ", ".join(body.id for body in self.bodies.items)
            raise PicktreeError(f"there is no item {item!r}; known: {known}")
        body = self.bodies[ObjectId(item)]
        if not body.present:
            raise PicktreeError(f"item {item!r} was taken away before")
        return body

    def _posture(self) -> Posture:
        q = self.arm.position
        return Posture(q, self.gripper.width, self.model.tcp(q), self._believed.tcp(q))


def _restored_body(item: SpawnedItem, saved: checkpoints.ItemState) -> KinematicBody:
    entry = replace(item.entry, mass=saved.mass)
    if saved.scale != 1.0:
        entry = replace(entry, shape=scaled(entry.shape, saved.scale))
    return KinematicBody(item.id, entry, item.colour, saved.pose, saved.friction, saved.present, saved.scale)
