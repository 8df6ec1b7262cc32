"""MuJoCo model of a cell: the robot, fixtures, items, gripper and wrist sensor."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cell_description import Cell, CellError, GripperEntry, RobotEntry, Solid
from .cell_faults import CellFaults
from .robot_model import TCP, WRIST, MakersModel, RobotSpec, robot_spec

STEP = 0.001
"""Length of a step of physics and servo, s."""
JOINT_FRICTION_SHARE = (0.002, 0.005)
"""Coulomb friction of a joint, as a share of its torque limit; drawn for each."""
ARMATURE_PER_TORQUE = (0.002, 0.05)
"""Inertia of a joint's rotor behind its gear: share of the torque limit, kg·m² per Nm, and its least
value."""
FINGER_ARMATURE, HINGE_ARMATURE = 0.05, 0.001
"""Inertia of a finger's motor: of a slider, kg, of a hinge, kg·m²."""
PAD_CONTACT_TIME = 0.01
"""Time constant of a contact with the pads, s: with 4 kg behind it 4·10⁴ N/m, as of rubber."""
ROBOT_COLOUR = (0.75, 0.75, 0.75, 1.0)
SEEN_GROUPS = (0, 1, 2)
"""Groups of geoms that cameras see: by MuJoCo's convention those of models that only collide are in 3."""
FLOOR_GROUP = 4
"""Group of the floor, far below what cameras look at: they do not see it."""
_FORMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


@dataclass(frozen=True, slots=True, eq=False)
class CellModel:
    """Compiled model, and the addresses of its parts."""

    model: mujoco.MjModel
    arm_q: NDArray[np.intp]
    arm_v: NDArray[np.intp]
    finger_q: NDArray[np.intp]
    finger_v: NDArray[np.intp]
    hand: int
    """Body beyond the wrist sensor."""
    wrist: int
    """Site of the wrist sensor, with the flange's axes."""
    tcp: int
    """Site of the TCP."""
    base: int
    """First body of the robot."""
    item_q: dict[str, int]
    item_v: dict[str, int]


def build_model(cell: Cell, faults: CellFaults, seed: int, makers: MakersModel | None = None) -> CellModel:
    """Build the model of a cell; `makers`: the robot's model in place of its URDF.

    Raises CellError for a robot that MuJoCo cannot read.
    """
    rng = np.random.default_rng([seed, 1])
    robot = robot_spec(cell.robot, makers)
    spec = robot.spec
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.gravity = [0.0, 0.0, -9.81]
    _dress_robot(robot, cell.robot, faults, rng)
    _add_sensor(spec)
    _add_gripper(robot, cell.robot.gripper)
    _add_fixtures(spec, cell)
    _add_items(spec, cell, faults, rng)
    try:
        model = spec.compile()
    except ValueError as error:
        raise CellError(f"the cell is no MuJoCo model: {error}") from None
    arm = [model.joint(name) for name in robot.joints]
    fingers = [model.joint(name) for name in robot.finger_joints]
    items = {item.id: model.joint(f"item/{item.id}") for item in cell.items}
    return CellModel(
        model,
        np.array([j.qposadr[0] for j in arm]),
        np.array([j.dofadr[0] for j in arm]),
        np.array([j.qposadr[0] for j in fingers]),
        np.array([j.dofadr[0] for j in fingers]),
        model.body(robot.hand).id,
        model.site(WRIST).id,
        model.site(TCP).id,
        model.body(robot.base).id,
        {name: int(j.qposadr[0]) for name, j in items.items()},
        {name: int(j.dofadr[0]) for name, j in items.items()},
    )


def _dress_robot(robot: RobotSpec, entry: RobotEntry, faults: CellFaults, rng: np.random.Generator) -> None:
    """Draw inertias and friction, and set what a URDF does not have."""
    spec = robot.spec
    known = {body.name for body in spec.bodies}
    hand = {robot.hand, *(body.name for body in spec.body(robot.hand).find_all("body"))}
    of_hand = 1.0 + faults.hand_mass_error * rng.uniform(-1.0, 1.0)
    for body in spec.bodies:
        share = 1.0 + faults.inertia_error * rng.uniform(-1.0, 1.0)
        share = of_hand if body.name in hand else share
        if body.mass > 0.0:
            body.mass *= share
            body.inertia = np.array(body.inertia) * share
            body.fullinertia = np.array(body.fullinertia) * share
        _dress_body(body, entry.gripper, pads=body.name in robot.finger_links, of_maker=robot.of_maker)
    joints = {joint.name: joint for joint in spec.joints}
    for name, limits in zip(robot.joints, entry.joints, strict=True):
        joint = joints[name]
        own = rng.uniform(*JOINT_FRICTION_SHARE)
        if not robot.of_maker:
            share, least = ARMATURE_PER_TORQUE
            joint.armature = max(least, share * limits.torque)
            joint.frictionloss = limits.torque * own
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.frictionloss += faults.joint_friction
        spec.add_actuator(name=f"motor/{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    # The parts of a hand that joints couple would jam each other; the fingers alone meet.
    fingers = set(robot.finger_links)
    inside = [(a, b) for a in sorted(hand) for b in sorted(hand) if a < b and {a, b} != fingers]
    for one, other in dict.fromkeys([*entry.excluded, *inside]):
        if one in known and other in known:
            spec.add_exclude(bodyname1=one, bodyname2=other)


def _dress_body(body: mujoco.MjsBody, gripper: GripperEntry, *, pads: bool, of_maker: bool) -> None:
    """Set the contacts of a link, and the looks that a URDF does not have."""
    for geom in body.geoms:
        geom.condim = 4
        geom.friction = [gripper.friction if pads else 0.3, 0.005, 1e-4]
        geom.solref = [PAD_CONTACT_TIME if pads else 0.004, 1.0]
        if not of_maker:
            geom.rgba = ROBOT_COLOUR
            geom.mass = 0.0


def _add_sensor(spec: mujoco.MjSpec) -> None:
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=f"picktree/{name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=WRIST)


def _add_gripper(robot: RobotSpec, gripper: GripperEntry) -> None:
    """Add motors, and let all finger joints follow the first one, unless the model couples them itself."""
    spec = robot.spec
    joints = {joint.name: joint for joint in spec.joints}
    coupled = bool(spec.equalities)
    drive = np.array([row[0] for row in gripper.positions])
    for n, name in enumerate(robot.finger_joints):
        joint = joints[name]
        if not robot.of_maker:
            joint.armature = FINGER_ARMATURE if gripper.sliders else HINGE_ARMATURE
            joint.damping[0] = 1.0 if gripper.sliders else 0.01
            joint.frictionloss = 0.2 if gripper.sliders else 0.0
            # The servo limits the force to the gripper's own; a URDF's effort is often less.
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
            if n or not gripper.sliders:
                joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        if gripper.sliders or not n:
            spec.add_actuator(name=f"motor/{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if n and not coupled:
            slope, offset = np.polyfit(drive, [row[n] for row in gripper.positions], 1)
            data = np.zeros(12)
            data[:2] = offset, slope
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT,
                name1=name,
                name2=robot.finger_joints[0],
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                data=data,
                solref=[0.004, 1.0],
            )


def _add_fixtures(spec: mujoco.MjSpec, cell: Cell) -> None:
    world = spec.worldbody
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0.0, 0.0, cell.floor], size=[5.0, 5.0, 0.1], group=FLOOR_GROUP
    )
    for fixture in cell.fixtures:
        # A body for each: rays skip bodies that are out of their way.
        name = f"fixture/{fixture.id}"
        body = world.add_body(name=name, pos=fixture.place.at, quat=fixture.place.wxyz)
        geom = _add_solid(spec, body, name, fixture.solid)
        geom.rgba = [*fixture.colour, 1.0]
        geom.friction = [0.5, 0.005, 1e-4]
        geom.condim = 4
        geom.solref = [0.003, 1.0]
        geom.solimp = [0.98, 0.999, 1e-4, 0.5, 2.0]


def _add_items(spec: mujoco.MjSpec, cell: Cell, faults: CellFaults, rng: np.random.Generator) -> None:
    for item in cell.items:
        x, y, z = item.place.at
        body = spec.worldbody.add_body(name=f"item/{item.id}", pos=[x, y, z + 1e-4], quat=item.place.wxyz)
        body.add_freejoint(name=f"item/{item.id}")
        mass = item.mass * (1.0 + faults.item_mass_error * rng.uniform(-1.0, 1.0))
        rolls = item.form in ("sphere", "cylinder")
        for n, part in enumerate(item.parts):
            geom = _add_solid(spec, body, f"item/{item.id}/{n}", part)
            geom.mass = mass / len(item.parts)
            geom.rgba = [*item.colour, 1.0]
            geom.priority = 1
            geom.condim = 6 if rolls else 4
            geom.friction = [item.friction, 0.003, 3e-4 if rolls else 1e-4]
            geom.solref = [0.004, 1.0]
            geom.solimp = [0.95, 0.999, 2e-4, 0.5, 2.0]


def _add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, solid: Solid) -> mujoco.MjsGeom:
    """Add a solid in the frame of a body."""
    if solid.form == "mesh":
        spec.add_mesh(
            name=name, uservert=list(solid.vertices), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        )
        return body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    return body.add_geom(name=name, type=_FORMS[solid.form], size=[*solid.size, 0.0, 0.0][:3])
