"""MuJoCo model of a cell: the robot by MuJoCo's URDF reader, fixtures, items, gripper and wrist sensor."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cell_description import Cell, CellError, GripperEntry, RobotEntry, Solid
from .cell_faults import CellFaults

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
UNSEEN_GROUP = 3
"""Group of geoms that cameras do not see: the floor, far below what they look at."""
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
    flange: int
    """Body beyond the flange joint, whose frame is that of the wrist sensor."""
    tcp_link: int
    base: int
    """First body of the robot."""
    item_q: dict[str, int]
    item_v: dict[str, int]


def build_model(cell: Cell, faults: CellFaults, seed: int) -> CellModel:
    """Build the model of a cell. Raises CellError for a robot that MuJoCo cannot read."""
    rng = np.random.default_rng([seed, 1])
    robot = cell.robot
    spec = _robot_spec(robot)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.gravity = [0.0, 0.0, -9.81]
    flange = _child_of(robot.urdf, robot.flange_joint)
    base = _place_base(spec, robot)
    _dress_robot(spec, robot, faults, rng)
    _add_sensor(spec, flange)
    _add_gripper(spec, robot.gripper)
    _add_fixtures(spec, cell)
    _add_items(spec, cell, faults, rng)
    try:
        model = spec.compile()
    except ValueError as error:
        raise CellError(f"the cell is no MuJoCo model: {error}") from None
    arm = [model.joint(j.name) for j in robot.joints]
    fingers = [model.joint(name) for name in robot.gripper.joints]
    items = {item.id: model.joint(f"item/{item.id}") for item in cell.items}
    return CellModel(
        model,
        np.array([j.qposadr[0] for j in arm]),
        np.array([j.dofadr[0] for j in arm]),
        np.array([j.qposadr[0] for j in fingers]),
        np.array([j.dofadr[0] for j in fingers]),
        model.body(flange).id,
        model.body(robot.tcp_link).id,
        model.body(base).id,
        {name: int(j.qposadr[0]) for name, j in items.items()},
        {name: int(j.dofadr[0]) for name, j in items.items()},
    )


def _robot_spec(robot: RobotEntry) -> mujoco.MjSpec:
    """Read the URDF. All links stay bodies of their own, because the wrist sensor is between two of them."""
    try:
        root = ElementTree.fromstring(robot.urdf)
    except ElementTree.ParseError as error:
        raise CellError(f"the robot's URDF is no XML: {error}") from None
    for link in root.findall("link"):
        for contact in link.findall("contact"):
            link.remove(contact)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(
        extension,
        "compiler",
        fusestatic="false",
        discardvisual="true",
        balanceinertia="true",
        boundmass="1e-4",
        boundinertia="1e-7",
    )
    try:
        return mujoco.MjSpec.from_string(
            ElementTree.tostring(root, encoding="unicode"), assets=dict(robot.meshes)
        )
    except ValueError as error:
        raise CellError(f"MuJoCo cannot read the robot's URDF: {error}") from None


def _place_base(spec: mujoco.MjSpec, robot: RobotEntry) -> str:
    """Put the robot at its base; return the name of its first body."""
    first = spec.worldbody.first_body()
    if first is None:
        raise CellError("the robot's URDF has no links")
    first.pos, first.quat = robot.base.at, robot.base.wxyz
    return str(first.name)


def _dress_robot(
    spec: mujoco.MjSpec, robot: RobotEntry, faults: CellFaults, rng: np.random.Generator
) -> None:
    """Draw inertias and friction, and set what the URDF does not have."""
    known = {body.name for body in spec.bodies}
    hand = {body.name for body in spec.body(_child_of(robot.urdf, robot.flange_joint)).find_all("body")}
    hand.add(_child_of(robot.urdf, robot.flange_joint))
    of_hand = 1.0 + faults.hand_mass_error * rng.uniform(-1.0, 1.0)
    for body in spec.bodies:
        share = 1.0 + faults.inertia_error * rng.uniform(-1.0, 1.0)
        share = of_hand if body.name in hand else share
        if body.mass > 0.0:
            body.mass *= share
            body.inertia = np.array(body.inertia) * share
            body.fullinertia = np.array(body.fullinertia) * share
        pads = body.name in robot.gripper.links
        for geom in body.geoms:
            geom.rgba = ROBOT_COLOUR
            geom.mass = 0.0
            geom.condim = 4
            geom.friction = [robot.gripper.friction if pads else 0.3, 0.005, 1e-4]
            geom.solref = [PAD_CONTACT_TIME if pads else 0.004, 1.0]
    joints = {joint.name: joint for joint in spec.joints}
    for entry in robot.joints:
        if entry.name not in joints:
            raise CellError(f"the robot's URDF has no joint {entry.name!r}")
        joint = joints[entry.name]
        share, least = ARMATURE_PER_TORQUE
        joint.armature = max(least, share * entry.torque)
        joint.frictionloss = entry.torque * rng.uniform(*JOINT_FRICTION_SHARE) + faults.joint_friction
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_actuator(name=f"motor/{entry.name}", target=entry.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    # The parts of a hand that joints couple would jam each other; the fingers alone meet.
    fingers = set(robot.gripper.links)
    inside = [(a, b) for a in sorted(hand) for b in sorted(hand) if a < b and {a, b} != fingers]
    for one, other in dict.fromkeys([*robot.excluded, *inside]):
        if one in known and other in known:
            spec.add_exclude(bodyname1=one, bodyname2=other)


def _child_of(urdf: str, joint: str) -> str:
    for element in ElementTree.fromstring(urdf).findall("joint"):
        child = element.find("child")
        if element.get("name") == joint and child is not None:
            return child.get("link", "")
    raise CellError(f"the robot's URDF has no flange joint {joint!r}")


def _add_sensor(spec: mujoco.MjSpec, flange: str) -> None:
    spec.body(flange).add_site(name="wrist")
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrist")


def _add_gripper(spec: mujoco.MjSpec, gripper: GripperEntry) -> None:
    """Add motors, and let all finger joints follow the first one."""
    joints = {joint.name: joint for joint in spec.joints}
    if missing := [name for name in gripper.joints if name not in joints]:
        raise CellError(f"the robot's URDF has no joint {missing[0]!r}")
    drive = np.array([row[0] for row in gripper.positions])
    for n, name in enumerate(gripper.joints):
        joint = joints[name]
        joint.armature = FINGER_ARMATURE if gripper.sliders else HINGE_ARMATURE
        joint.damping[0] = 1.0 if gripper.sliders else 0.01
        joint.frictionloss = 0.2 if gripper.sliders else 0.0
        if n or not gripper.sliders:
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        if gripper.sliders or not n:
            spec.add_actuator(name=f"motor/{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if n:
            slope, offset = np.polyfit(drive, [row[n] for row in gripper.positions], 1)
            data = np.zeros(12)
            data[:2] = offset, slope
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT,
                name1=name,
                name2=gripper.joints[0],
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                data=data,
                solref=[0.004, 1.0],
            )


def _add_fixtures(spec: mujoco.MjSpec, cell: Cell) -> None:
    world = spec.worldbody
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0.0, 0.0, cell.floor], size=[5.0, 5.0, 0.1], group=UNSEEN_GROUP
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
