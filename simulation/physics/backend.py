"""Physics backend: robot, bins and items in pybullet, behind the protocols of the hardware."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from picktree.files import PicktreeError, library_parts
from picktree.simulation import (
    MIN_ITEM_CLEARANCE,
    MIN_OBSTACLE_CLEARANCE,
    BeltDrive,
    DeviceFaults,
    Feeder,
    FeederState,
    FreeSpaceCheck,
    HoledFixtures,
    RobotSensorNoise,
    TrueBody,
    TrueObstacle,
    checkpoints,
    displace_fixtures,
    enlarged_item,
    fault_entries,
    has_feeder,
    jam_command,
    placed_item,
    spawn_items,
    walls,
)
from picktree.world import (
    GRAVITY,
    Camera,
    Clock,
    Feed,
    JournalEvent,
    NoFeed,
    ObjectId,
    Pose,
    RandomStreams,
    SensorStamps,
    Shape,
    Vector3,
)
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import Fixture, SceneDescription

from .belts import PhysicsBelts, PhysicsCell
from .contacts import ContactPoints, CrushDetector, Penetrations, TrueContact
from .devices import IdealSensors, PhysicsArm, PhysicsGripper, PhysicsWrench
from .engine import (
    CONTACT_DISTANCE,
    EVERYDAY_STEP_RATE,
    HEAP_CONTACT_DISTANCE,
    RESIDUAL_THRESHOLD,
    RESOLUTION,
    SOLVER_ITERATIONS,
    Client,
    check_step_rate,
    pb,
    reset,
    set_step_rate,
)
from .items import REST, SLEEP_CHECK_INTERVAL, PhysicsItems
from .rgbd_camera import PhysicsCamera, StaticScene
from .robot_body import RobotBody
from .static_bodies import StaticBodies


class PhysicsHardware:
    """`protocols.Hardware` over a pybullet client of its own. Several may live in one process.

    Bodies move by `stepSimulation` alone; poses are set at spawn, on restore and by named faults.
    """

    def __init__(
        self,
        scene: SceneDescription,
        robot: RobotDescription,
        seed: int,
        start: checkpoints.Checkpoint | None = None,
    ) -> None:
        self.scene = scene
        self.robot = robot
        self.seed = seed
        self._real = displace_fixtures(scene, seed)
        self._streams = RandomStreams(seed)
        self._contact_distance = HEAP_CONTACT_DISTANCE if scene.heaped else CONTACT_DISTANCE
        client = Client()
        self.close = client.close
        """Function that frees the client. That happens by itself when hardware and devices are no longer
        used."""
        self._client = client.id
        self._body = RobotBody(robot, client, 1 / EVERYDAY_STEP_RATE)
        noise = RobotSensorNoise(scene.noise, self._streams, len(robot.joints))
        self._senses = senses = IdealSensors(noise, checkpoints.RobotReading((), (), (), ()))
        self.clock: Clock = senses
        self.period = senses.period
        self._belts = PhysicsBelts(scene, client.id)
        self._items = PhysicsItems(scene, spawn_items(scene, seed), client.id, self._belts.running)
        self._boards = HoledFixtures(self._real.fixtures)
        self.penetrations = Penetrations(client.id)
        """Penetration of items and fixtures with holes, for tests and benchmarks."""
        self._static = StaticBodies(self._real, robot.base_in_world, client.id)
        self._contacts = ContactPoints(self._body, self._items, self._static, client.id)
        self._room: FreeSpaceCheck | None = None
        self.faults = DeviceFaults(c.name for c in scene.cameras)
        self.arm = PhysicsArm(senses, self._body, self.faults)
        self._model: RobotModel | None = None
        scenery = StaticScene(self._real)
        tcps = self._body.tcp, self._believed_tcp
        self._cameras = MappingProxyType(
            {
                c.name: PhysicsCamera(
                    c, scenery, self._streams, client, senses, *tcps, self.faults, self._items.stickers
                )
                for c in scene.cameras
            }
        )
        self.gripper = PhysicsGripper(senses, self._body)
        limits = {e.kind: e.force_limit for e in scene.catalogue if e.force_limit is not None}
        self.crushing = CrushDetector(self._body, self._items, limits, client.id)
        """Forces of the fingers on fragile items, for tests and benchmarks."""
        self.wrench = PhysicsWrench(senses, self.faults)
        self._feeder: Feeder | None = None
        if has_feeder(scene):
            self._feeder = Feeder(scene, PhysicsCell(robot, self._items, senses), seed, self._belts.drives)
        self.feed: Feed = self._feeder or NoFeed()
        if start is None:
            self._empty(scene.unknown)
            self._items.spawn(self._static.names)
            self.penetrations.watch(self._items.numbers, self._static.holed)
            self._belts.build(self._static.names)
            self._items.settle(scene)
            self._senses.reading = self._body.read()
            self._initial = tuple(replace(s, asleep=False) for s in self._items.states())
        else:
            self.restore(start)

    @classmethod
    def resume(
        cls, scene: SceneDescription, robot: RobotDescription, seed: int, checkpoint: checkpoints.Checkpoint
    ) -> PhysicsHardware:
        """Build the hardware from a checkpoint, in this process or another. It continues bit for bit like the
        run that made it."""
        return cls(scene, robot, seed, checkpoint)

    takes_torque = True
    latency = 0.0
    preview = ()

    @property
    def feels_effort(self) -> bool:
        return True

    @property
    def stamps(self) -> SensorStamps:
        now = self._senses.now
        return SensorStamps(now, now, self.wrench.stamp)

    def pace(self, rate: int | None = None) -> None:
        """Set the rate of steps and control, Hz; None: the everyday rate. The contact solver gets suitable
        settings. Raises PicktreeError for an impossible rate."""
        rate = EVERYDAY_STEP_RATE if rate is None else check_step_rate(rate)
        if rate != self._senses.rate:
            self._senses.pace(rate)
            self.period = self._senses.period
            set_step_rate(rate, self._client)
            self._body.pace(1 / rate)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        return self._cameras

    @property
    def belts(self) -> Mapping[ObjectId, BeltDrive]:
        """Belts by name, for the feed; the robot has no access."""
        return self._belts.drives

    def settings(self) -> Mapping[str, str]:
        """Return the settings of the physics for the record."""
        return {
            "backend": "physics",
            "engine": f"pybullet {library_parts.library_version('pybullet')}",
            "step": f"{1 / EVERYDAY_STEP_RATE:.9f} s",
            "solver_iterations": str(SOLVER_ITERATIONS),
            "solver_residual_threshold": str(RESIDUAL_THRESHOLD),
            "contact_distance": f"{self._contact_distance} m",
            "gravity": f"{GRAVITY} m/s²",
            "sleep_after": f"{SLEEP_CHECK_INTERVAL * REST.checks / EVERYDAY_STEP_RATE:.2f} s",
        }

    def step(self) -> None:
        self._body.before_step()
        senses = self._senses
        self._belts.before_step(senses.period)
        pb.stepSimulation(self._client)
        self._belts.after_step()
        self.penetrations.stepped(senses.now)
        reading = self._body.read()
        self.crushing.stepped(senses.now, reading)
        if senses.stepped(reading):
            self._items.stepped()
            if self._feeder is not None:
                self._feeder.stepped(senses.everyday_steps)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events of feed and crush detection since the last call."""
        brought = self._feeder.take_events() if self._feeder is not None else ()
        return (*brought, *self.crushing.take_events())

    def vary_noise(self, variant: int) -> None:
        """Draw the noise of the sensors from that variant of their streams; a bias does not change."""
        self._streams.variant = variant

    def checkpoint(self) -> checkpoints.Checkpoint:
        """Save, reset, rebuild and restore the simulation. The run continues as a resumed run would: contact
        caches and solver history are dropped in both."""
        saved = self._save()
        self.restore(saved)
        return saved

    def restore(self, saved: checkpoints.Checkpoint) -> None:
        """Restore a checkpoint of the same scene, robot and seed. Raises PicktreeError when it does not
        fit."""
        saved.require_fit(self.seed, list(self._items.inventory.spawned), self._cameras)
        self._empty(self.scene.unknown if saved.obstacles is None else saved.obstacles)
        self._items.restore(saved.items, saved.ledger, saved.inventory, self._static.names)
        self._belts.build(self._static.names)
        self.penetrations.watch(self._items.numbers, self._static.holed)
        self._belts.restore(saved.belts)
        self._items.restore_sleep(saved.items)
        self._body.restore(saved.robot, saved.arm, saved.gripper)
        if self.faults.any:
            self._apply_device_faults()
        time = saved.step * RESOLUTION // EVERYDAY_STEP_RATE if saved.time is None else saved.time
        self._senses.start(saved.step, time, saved.robot)
        self._initial = saved.initial
        self.crushing.restore(saved.pressed)
        for name, camera in self._cameras.items():
            camera.captures = saved.captures[name]
        if self._feeder is not None:
            self._feeder.restore(saved.feeder or FeederState())

    def _save(self) -> checkpoints.Checkpoint:
        if self._senses.rate != EVERYDAY_STEP_RATE:
            raise PicktreeError("a checkpoint is not taken while the simulation is stepped finely")
        return self.snapshot()

    def snapshot(self) -> checkpoints.Checkpoint:
        """Return the state at any moment, without side effects. A run that continues from it is not
        bit-exact."""
        return checkpoints.Checkpoint(
            seed=self.seed,
            step=self._senses.step,
            captures={name: camera.captures for name, camera in self._cameras.items()},
            arm=self._body.command,
            gripper=self._body.grip,
            robot=self._senses.reading,
            items=self._items.states(),
            initial=self._initial,
            ledger=self._items.ledger,
            belts=self._belts.states(),
            inventory=self._items.inventory.state(),
            feeder=self._feeder.state() if self._feeder is not None else None,
            obstacles=self._static.obstacles.here,
            time=self._senses.time,
            pressed=self.crushing.state(),
        )

    def truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of every item that ever came, for the scorer only; see
        `Inventory.truth`."""
        return self._with_marks(self._items.truth())

    def recent_truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth for faults and the analyst's log only; see `Inventory.recent_truth`."""
        return self._with_marks(self._items.recent_truth())

    @property
    def item_count(self) -> int:
        """Number of items that ever came."""
        return self._items.inventory.count

    def _with_marks(self, bodies: Iterable[TrueBody]) -> tuple[TrueBody, ...]:
        """Return the bodies with their crush forces and their seating in holes."""
        crushed = map(self.crushing.with_crush_force, bodies)
        return tuple(map(self._seated, crushed)) if self._boards else tuple(crushed)

    def true_fixtures(self) -> tuple[Fixture, ...]:
        """Return the scene's fixtures at their true poses."""
        return self._real.fixtures

    def _seated(self, body: TrueBody) -> TrueBody:
        """Return the body with its seating in a hole."""
        seat = self._boards.seat(body.shape, body.pose) if body.present else None
        if seat is None:
            return body
        return replace(body, seat=replace(seat, penetration=self.penetrations.of(body.id)))

    @property
    def initial_truth(self) -> tuple[TrueBody, ...]:
        """Ground truth at time 0."""
        return tuple(self._items.true(state) for state in self._initial)

    def _believed_tcp(self) -> Pose:
        """Return the TCP pose in the world by the encoders."""
        self._model = self._model or RobotModel(replace(self.robot, tool=self.scene.tool))
        return self._model.tcp(self.arm.read().position)

    def true_tcp(self) -> Pose:
        """Return the true TCP pose in the world, for tests."""
        return self._body.tcp()

    def true_contacts(self) -> tuple[TrueContact, ...]:
        """Return the contact points of the last step, for tests and the analyst."""
        return self._contacts.all()

    def remove(self, item: str) -> None:
        """Carry out a fault: remove the item."""
        self._items.remove(item)

    def change_dynamics(self, item: str, friction: float | None = None, mass: float | None = None) -> None:
        """Carry out a fault: change the item's friction, or its mass in kg, for good."""
        self._items.change_dynamics(item, friction, mass)

    def friction_of(self, item: str) -> float:
        return self._items.friction_of(item)

    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """Carry out a fault: set the item's velocity, m/s, and spin, rad/s, in the world."""
        self._items.bump(item, velocity, spin)

    def in_hand(self) -> ObjectId | None:
        """Return the item that every finger touches; None without one."""
        return self._contacts.in_hand()

    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """Carry out a fault: set the item's friction; None: its own again. `again`: it had that friction
        already when the checkpoint was taken."""
        self._items.lubricate(item, friction, again=again)

    def enlarge(self, item: str, factor: float) -> bool:
        """Carry out a fault: scale the item by `factor` with constant mass and friction. Returns False when
        items or robot leave no room."""
        body = next(body for body in self._items.here() if body.id == item)
        entry, pose = enlarged_item(self._items.inventory.here[body.id].entry, body.pose, factor)
        if not self._free(entry.shape, pose, self._items.places(but=item), MIN_ITEM_CLEARANCE):
            return False
        self._items.enlarge(item, factor, pose)
        return True

    def appear(self, kind: str, colour: str, place: tuple[float, float], yaw: float) -> ObjectId | None:
        """Carry out a fault: add an item at `place`; None: something is there now. Raises PicktreeError where
        no fixture is below."""
        item = placed_item(self._real, self._items.inventory.next_id(), kind, colour, place, yaw)
        others = (*self._items.places(), *walls(self.scene))
        if not self._free(item.entry.shape, item.pose, others, MIN_ITEM_CLEARANCE):
            return None
        self._items.put(item)
        return item.id

    def afflict(
        self, number: int, fault: fault_entries.LastingFault, held: tuple[float, ...] | None = None
    ) -> None:
        """Begin a fault of a device. `held` is given on restore: the device's state when the fault began."""
        self.faults.begin(number, fault, self._doing(fault) if held is None else held)
        if isinstance(fault, fault_entries.Stall) and held is None:
            n = len(self.robot.joints)
            self._body.follow(self._senses.reading.position[:n], (0.0,) * n)
        self._apply_device_faults()

    def relieve(self, number: int) -> None:
        """End a fault of a device."""
        self.faults.end(number)
        self._apply_device_faults()

    def _doing(self, fault: fault_entries.LastingFault) -> tuple[float, ...]:
        """Return the present state of the device that a fault affects, as `DeviceFaults` keeps it."""
        match fault:
            case fault_entries.GripperJam():
                reading, n = self._senses.reading, len(self.robot.joints)
                width = self._body.fingers.width(reading.position[n:])
                return jam_command(self._body.grip, width, self.robot.gripper.max_force)
            case fault_entries.WrenchDead():
                reading = self.wrench.read()
                return (*reading.force, *reading.torque, self.wrench.stamp)
            case _:
                return (0.0,) if fault_entries.counted(fault) else ()

    def _apply_device_faults(self) -> None:
        faults = self.faults
        self._body.weaken(faults.torque_shares, faults.jam, faults.grip_share)

    def obstacles(self) -> tuple[TrueObstacle, ...]:
        """Return the obstacles that are unknown to the robot."""
        return self._static.obstacles.truth()

    def room_for(self, body: Fixture) -> bool:
        """Return whether the body's place is free of items and robot."""
        return self._free(body.shape, body.pose, self._items.places(), MIN_OBSTACLE_CLEARANCE)

    def _free(self, shape: Shape, pose: Pose, others: Iterable[tuple[Shape, Pose]], room: float) -> bool:
        """Return whether a body fits between the bodies `others` and the robot, with clearance `room`, m."""
        self._room = self._room or FreeSpaceCheck(RobotModel(self.robot))
        position, n = self._senses.reading.position, len(self.robot.joints)
        return self._room.free(shape, pose, others, np.array(position[:n]), sum(position[n:]), room)

    def put_obstacle(self, body: Fixture) -> ObjectId:
        """Carry out a fault: add an obstacle and return its name."""
        name = self._static.obstacles.put(body)
        self._items.sleepers.add_static(self._static.number(name))
        return name

    def take_obstacle(self, name: ObjectId) -> None:
        """Remove an obstacle that a fault has added."""
        self._static.obstacles.take(name)
        self._items.sleepers.wake_all()

    def _empty(self, obstacles: Iterable[Fixture]) -> None:
        """Reset the simulation to one without items and belts; everything else is added in a fixed order."""
        reset(self._client, self._contact_distance)
        self._senses.pace(EVERYDAY_STEP_RATE)
        self.period = self._body.period = self._senses.period
        self._static.load()
        self._body.load()
        self._static.obstacles.renew(obstacles)
