"""The physical backend: robot, bins and items in pybullet, behind the protocols of the hardware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from types import MappingProxyType

import numpy as np

from ..errors import PicktreeError
from ..no_feed import NoFeed
from ..protocols import Camera, Clock, Feed
from ..robot.description import RobotDescription
from ..scene.description import SceneDescription
from ..streams import Streams
from ..values import ObjectId, Pose, Vector3
from .belt_drive import BeltDrive
from .belts import Belts
from .bodies import add_fixed, add_item, forget_contacts, set_friction, set_mass
from .camera import PhysicsCamera, backgrounds
from .checkpoint import BodyState, Checkpoint, DynamicsChange, RobotReading
from .client import Client
from .devices import PERIOD, PhysicsArm, PhysicsGripper, PhysicsWrench, Senses
from .engine import pb
from .noise import BodyNoise
from .robot_body import RobotBody, finite
from .sleeping import EVERY, REST_LOOKS, Sleepers
from .spawn import SpawnedItem, spawn_items
from .truth import TrueBody

GRAVITY = 9.81
"""m/s²"""
SOLVER_ITERATIONS = 50
RESIDUAL_THRESHOLD = 3e-7
"""At 1e-5 boxes creep 0.15 mm/s over the table unless they get rolling friction, at three times the cost."""
SETTLE_MOST = 600
"""Steps before time 0, if something never comes to rest."""


@dataclass(frozen=True, slots=True)
class TrueContact:
    """One contact point: names of items, fixtures, bins or robot links; for tests and the analyst."""

    one: str
    other: str
    distance: float
    """m; negative when they penetrate."""
    force: float
    """Along the normal, N."""


class PhysicsHardware:
    """`protocols.Hardware` over a pybullet client of its own. Several may live in one process.

    Bodies move by `stepSimulation` alone; poses are set at spawn, on restore and by named faults.
    """

    def __init__(
        self, scene: SceneDescription, robot: RobotDescription, seed: int, start: Checkpoint | None = None
    ) -> None:
        self.scene = scene
        self.robot = robot
        self.seed = seed
        self._streams = Streams(seed)
        client = Client()
        self.close = client.close
        """Frees the client; it happens by itself when hardware and devices are no longer used."""
        self._client = client.id
        self._body = RobotBody(robot, client, PERIOD)
        noise = BodyNoise(scene.noise, self._streams, len(robot.joints))
        self._senses = senses = Senses(noise, 0, RobotReading((), (), (), ()))
        self._items: Mapping[ObjectId, SpawnedItem] = {i.id: i for i in spawn_items(scene, seed)}
        self._ledger: list[DynamicsChange] = []
        self._gone: dict[ObjectId, BodyState] = {}
        self._numbers: dict[ObjectId, int] = {}
        self._belts = Belts(scene, client.id, PERIOD)
        self._sleepers = Sleepers(client.id, self._belts.running)
        self._bumps: dict[ObjectId, tuple[Vector3, Vector3]] = {}
        self._fixed: dict[int, str] = {}
        behind = backgrounds(scene)
        self._cameras = MappingProxyType(
            {c.name: PhysicsCamera(c, behind[c.name], self._streams, client, senses) for c in scene.cameras}
        )
        self.arm = PhysicsArm(senses, self._body)
        self.gripper = PhysicsGripper(senses, self._body)
        self.wrench = PhysicsWrench(senses)
        self.feed: Feed = NoFeed()
        if start is None:
            self._build({name: item.pose for name, item in self._items.items()})
            self._settle()
            self._senses.reading = self._body.read()
            self._initial = tuple(self._state(name) for name in self._items)
        else:
            self.restore(start)

    @classmethod
    def resume(
        cls, scene: SceneDescription, robot: RobotDescription, seed: int, checkpoint: Checkpoint
    ) -> PhysicsHardware:
        """Continue from a checkpoint, in this process or another: bit for bit as the run that made it."""
        return cls(scene, robot, seed, checkpoint)

    @property
    def clock(self) -> Clock:
        return self._senses

    @property
    def period(self) -> float:
        return PERIOD

    @property
    def cameras(self) -> Mapping[str, Camera]:
        return self._cameras

    @property
    def belts(self) -> Mapping[ObjectId, BeltDrive]:
        """For whoever brings items: the robot has no word in it."""
        return self._belts.drives

    def settings(self) -> Mapping[str, str]:
        """What a record has to say about the physics."""
        return {
            "backend": "physics",
            "engine": f"pybullet {version('pybullet')}",
            "step": f"{PERIOD:.9f} s",
            "solver_iterations": str(SOLVER_ITERATIONS),
            "solver_residual_threshold": str(RESIDUAL_THRESHOLD),
            "gravity": f"{GRAVITY} m/s²",
            "sleep_after": f"{EVERY * REST_LOOKS * PERIOD:.2f} s",
        }

    def step(self) -> None:
        self._body.before_step()
        self._belts.before_step()
        pb.stepSimulation(self._client)
        self._belts.after_step()
        if self._bumps:
            self._carry_out_bumps()
        senses = self._senses
        senses.step += 1
        self._sleepers.stepped()
        senses.reading = self._body.read()

    def checkpoint(self) -> Checkpoint:
        """Save → reset → rebuild → restore. The run goes on from what was saved, as a resumed run would:
        contact caches and solver history are dropped in both."""
        saved = self._save()
        self.restore(saved)
        return saved

    def restore(self, saved: Checkpoint) -> None:
        """Take up a checkpoint of the same scene, robot and seed."""
        if saved.seed != self.seed:
            raise PicktreeError(f"the checkpoint is of seed {saved.seed}, but this run has seed {self.seed}")
        for what, states in (("items", saved.items), ("initial items", saved.initial)):
            if (ids := [s.id for s in states]) != list(self._items):
                raise PicktreeError(
                    f"the checkpoint's {what} are {ids}, but the scene spawns {list(self._items)}"
                )
        if sorted(saved.captures) != sorted(self._cameras):
            raise PicktreeError(
                f"the checkpoint's cameras are {sorted(saved.captures)}, "
                f"but the scene has {sorted(self._cameras)}"
            )
        present = [s for s in saved.items if s.present]
        self._build({s.id: Pose(s.position, s.orientation) for s in present})
        for state in present:
            pb.resetBaseVelocity(self._numbers[state.id], state.velocity, state.spin, self._client)
        self._gone = {s.id: s for s in saved.items if not s.present}
        self._ledger = list(saved.ledger)
        for change in self._ledger:
            self._apply(change)
        self._belts.restore(saved.belts)
        self._sleepers.sleep([s.id for s in present if s.asleep])
        self._body.restore(saved.robot, saved.arm, saved.gripper)
        self._senses.reading = saved.robot
        self._senses.step = saved.step
        self._initial = saved.initial
        for name, camera in self._cameras.items():
            camera.captures = saved.captures[name]

    def _save(self) -> Checkpoint:
        asleep = self._sleepers.asleep()
        return Checkpoint(
            seed=self.seed,
            step=self._senses.step,
            captures={name: camera.captures for name, camera in self._cameras.items()},
            arm=self._body.command,
            gripper=self._body.grip,
            robot=self._senses.reading,
            items=tuple(replace(self._state(name), asleep=name in asleep) for name in self._items),
            initial=self._initial,
            ledger=tuple(self._ledger),
            belts=self._belts.states(),
        )

    def truth(self) -> tuple[TrueBody, ...]:
        """Every item that was spawned, as it really is: for scorer, faults and the analyst's log only."""
        return tuple(self._true(self._state(name)) for name in self._items)

    @property
    def initial_truth(self) -> tuple[TrueBody, ...]:
        """As `truth` at time 0."""
        return tuple(self._true(state) for state in self._initial)

    def true_tcp(self) -> Pose:
        """Where the tool really is in the world, for tests."""
        return self._body.tcp()

    def true_contacts(self) -> tuple[TrueContact, ...]:
        """Contact points of the last step, for tests and the analyst."""
        return tuple(
            TrueContact(self._name(c[1], c[3]), self._name(c[2], c[4]), c[8], c[9])
            for c in pb.getContactPoints(physicsClientId=self._client)
        )

    def remove(self, item: str) -> None:
        """A fault: the item is snatched away."""
        name = self._known(item)
        self._gone[name] = _at_rest(self._state(name))
        self._bumps.pop(name, None)
        pb.removeBody(self._numbers.pop(name), self._client)
        self._sleepers.wake_all()

    def change_dynamics(self, item: str, friction: float | None = None, mass: float | None = None) -> None:
        """A fault: the item becomes slippery, heavier or lighter, for good."""
        change = DynamicsChange(self._known(item), friction, mass)
        self._apply(change)
        forget_contacts(self._numbers[change.item], self._client)
        self._ledger.append(change)
        self._sleepers.wake_all()

    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """A fault: the item is hit and moves with `velocity`, m/s, and `spin`, rad/s, in the world."""
        finite(np.array(velocity, dtype=np.float64), f"{item}: velocity", (3,))
        finite(np.array(spin, dtype=np.float64), f"{item}: spin", (3,))
        # Whoever sleeps has to be woken first, which takes a step.
        self._bumps[self._known(item)] = (velocity, spin)
        self._sleepers.wake_all()

    def _build(self, poses: Mapping[ObjectId, Pose]) -> None:
        """An empty simulation, then everything in the same order as always."""
        client = self._client
        pb.resetSimulation(physicsClientId=client)
        pb.setGravity(0, 0, -GRAVITY, physicsClientId=client)
        pb.setTimeStep(PERIOD, client)
        pb.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS,
            solverResidualThreshold=RESIDUAL_THRESHOLD,
            deterministicOverlappingPairs=1,
            jointFeedbackMode=pb.JOINT_FEEDBACK_IN_WORLD_SPACE,
            physicsClientId=client,
        )
        self._fixed = add_fixed(self.scene, self.robot.base_in_world, client)
        self._body.load()
        self._numbers = {
            name: add_item(item, poses[name], client) for name, item in self._items.items() if name in poses
        }
        self._gone = {}
        self._bumps = {}
        self._sleepers.watch(self._numbers, self._fixed)
        # Slabs wake nothing either while they stand, but never sleep themselves.
        self._belts.build(self._fixed)

    def _settle(self) -> None:
        """Let everything come to rest before time 0."""
        for _ in range(SETTLE_MOST):
            pb.stepSimulation(self._client)
            self._sleepers.stepped()
            if self._sleepers.quiet:
                return

    def _carry_out_bumps(self) -> None:
        for name, (velocity, spin) in self._bumps.items():
            pb.resetBaseVelocity(self._numbers[name], velocity, spin, self._client)
        self._bumps.clear()

    def _apply(self, change: DynamicsChange) -> None:
        number = self._numbers.get(change.item)
        if number is None:
            return
        if change.friction is not None:
            set_friction(number, change.friction, self._client)
        if change.mass is not None:
            set_mass(number, self._items[change.item].entry.shape, change.mass, self._client)

    def _state(self, name: ObjectId) -> BodyState:
        if name in self._gone:
            return self._gone[name]
        number = self._numbers[name]
        position, orientation = pb.getBasePositionAndOrientation(number, self._client)
        velocity, spin = self._bumps.get(name) or pb.getBaseVelocity(number, self._client)
        return BodyState(name, position, orientation, velocity, spin, present=True)

    def _true(self, state: BodyState) -> TrueBody:
        item = self._items[state.id]
        entry = item.entry
        return TrueBody(
            state.id,
            entry.kind,
            entry.form,
            entry.shape,
            item.colour,
            Pose(state.position, state.orientation),
            state.velocity,
            state.spin,
            state.present,
        )

    def _known(self, item: str) -> ObjectId:
        name = ObjectId(item)
        if name not in self._items:
            raise PicktreeError(f"there is no item {item!r}; known: {', '.join(self._items)}")
        if name not in self._numbers:
            raise PicktreeError(f"item {item!r} was taken away before")
        return name

    def _name(self, body: int, link: int) -> str:
        if body == self._body.body:
            return self._body.links[link]
        if body in self._fixed:
            return self._fixed[body]
        return next((name for name, number in self._numbers.items() if number == body), "?")


def _at_rest(state: BodyState) -> BodyState:
    still = (0.0, 0.0, 0.0)
    return BodyState(state.id, state.position, state.orientation, still, still, present=False)
