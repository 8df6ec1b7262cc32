"""The part of pybullet's interface that picktree uses."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

DIRECT: int
GEOM_BOX: int
GEOM_CYLINDER: int
GEOM_SPHERE: int
GEOM_MESH: int
URDF_USE_INERTIA_FROM_FILE: int
URDF_USE_SELF_COLLISION: int
JOINT_REVOLUTE: int
JOINT_PRISMATIC: int
JOINT_FIXED: int
JOINT_GEAR: int
POSITION_CONTROL: int
VELOCITY_CONTROL: int
TORQUE_CONTROL: int
ER_TINY_RENDERER: int
ER_NO_SEGMENTATION_MASK: int
JOINT_FEEDBACK_IN_WORLD_SPACE: int
WORLD_FRAME: int
LINK_FRAME: int
ACTIVATION_STATE_ENABLE_SLEEPING: int
ACTIVATION_STATE_DISABLE_SLEEPING: int
ACTIVATION_STATE_SLEEP: int
ACTIVATION_STATE_WAKE_UP: int

class error(Exception): ...

Vec3: TypeAlias = tuple[float, float, float]
Vec4: TypeAlias = tuple[float, float, float, float]

def connect(method: int, /, *, options: str = ...) -> int: ...
def disconnect(physicsClientId: int = ...) -> None: ...
def isConnected(physicsClientId: int = ...) -> int: ...
def resetSimulation(*, physicsClientId: int = ...) -> None: ...
def stepSimulation(physicsClientId: int = ...) -> None: ...
def setGravity(gravX: float, gravY: float, gravZ: float, /, *, physicsClientId: int = ...) -> None: ...
def setTimeStep(timeStep: float, physicsClientId: int = ...) -> None: ...
def setPhysicsEngineParameter(
    *,
    numSolverIterations: int = ...,
    solverResidualThreshold: float = ...,
    deterministicOverlappingPairs: int = ...,
    jointFeedbackMode: int = ...,
    enableFileCaching: int = ...,
    contactERP: float = ...,
    contactBreakingThreshold: float = ...,
    erp: float = ...,
    physicsClientId: int = ...,
) -> None: ...
def setAdditionalSearchPath(path: str, *, physicsClientId: int = ...) -> None: ...
def loadURDF(
    fileName: str,
    basePosition: Sequence[float] = ...,
    baseOrientation: Sequence[float] = ...,
    *,
    useFixedBase: int = ...,
    flags: int = ...,
    physicsClientId: int = ...,
) -> int: ...
def getNumJoints(bodyUniqueId: int, physicsClientId: int = ...) -> int: ...
def getNumBodies(physicsClientId: int = ...) -> int: ...
def getBodyInfo(bodyUniqueId: int, physicsClientId: int = ...) -> tuple[bytes, bytes]: ...
def getCollisionShapeData(
    objectUniqueId: int, linkIndex: int, physicsClientId: int = ...
) -> tuple[tuple[int, int, int, Vec3, bytes, Vec3, Vec4], ...]: ...
def getJointInfo(bodyUniqueId: int, jointIndex: int, physicsClientId: int = ...) -> tuple[
    int, bytes, int, int, int, int, float, float, float, float, float, float, bytes, Vec3, Vec3, Vec4, int
]: ...
def getJointState(bodyUniqueId: int, jointIndex: int, physicsClientId: int = ...) -> tuple[
    float, float, tuple[float, float, float, float, float, float], float
]: ...
def getJointStates(bodyUniqueId: int, jointIndices: Sequence[int], *, physicsClientId: int = ...) -> tuple[
    tuple[float, float, tuple[float, float, float, float, float, float], float], ...
]: ...
def resetJointState(
    bodyUniqueId: int, jointIndex: int, targetValue: float, targetVelocity: float = ..., *, physicsClientId: int = ...
) -> None: ...
def enableJointForceTorqueSensor(
    bodyUniqueId: int, jointIndex: int, enableSensor: int, physicsClientId: int = ...
) -> None: ...
def setJointMotorControl2(
    bodyUniqueId: int,
    jointIndex: int,
    controlMode: int,
    *,
    targetPosition: float = ...,
    targetVelocity: float = ...,
    force: float = ...,
    positionGain: float = ...,
    velocityGain: float = ...,
    maxVelocity: float = ...,
    physicsClientId: int = ...,
) -> None: ...
def setJointMotorControlArray(
    bodyUniqueId: int,
    jointIndices: Sequence[int],
    controlMode: int,
    *,
    targetPositions: Sequence[float] = ...,
    targetVelocities: Sequence[float] = ...,
    forces: Sequence[float] = ...,
    positionGains: Sequence[float] = ...,
    velocityGains: Sequence[float] = ...,
    physicsClientId: int = ...,
) -> None: ...
def getLinkState(
    bodyUniqueId: int,
    linkIndex: int,
    computeLinkVelocity: int = ...,
    computeForwardKinematics: int = ...,
    physicsClientId: int = ...,
) -> tuple[Vec3, Vec4, Vec3, Vec4, Vec3, Vec4]: ...
def getConstraintState(constraintUniqueId: int, physicsClientId: int = ...) -> tuple[float, ...]: ...
def changeDynamics(
    bodyUniqueId: int,
    linkIndex: int,
    *,
    mass: float = ...,
    lateralFriction: float = ...,
    spinningFriction: float = ...,
    rollingFriction: float = ...,
    restitution: float = ...,
    linearDamping: float = ...,
    angularDamping: float = ...,
    jointDamping: float = ...,
    contactStiffness: float = ...,
    contactDamping: float = ...,
    frictionAnchor: int = ...,
    localInertiaDiagonal: Sequence[float] = ...,
    collisionMargin: float = ...,
    jointLowerLimit: float = ...,
    jointUpperLimit: float = ...,
    activationState: int = ...,
    sleepThreshold: float = ...,
    physicsClientId: int = ...,
) -> None: ...
def getDynamicsInfo(bodyUniqueId: int, linkIndex: int, physicsClientId: int = ...) -> tuple[
    float, float, Vec3, Vec3, Vec4, float, float, float, float, float, int, float
]: ...
def setCollisionFilterGroupMask(
    bodyUniqueId: int, linkIndexA: int, collisionFilterGroup: int, collisionFilterMask: int, *, physicsClientId: int = ...
) -> None: ...
def changeConstraint(
    userConstraintUniqueId: int,
    *,
    gearRatio: float = ...,
    erp: float = ...,
    maxForce: float = ...,
    physicsClientId: int = ...,
) -> None: ...
def createConstraint(
    parentBodyUniqueId: int,
    parentLinkIndex: int,
    childBodyUniqueId: int,
    childLinkIndex: int,
    jointType: int,
    jointAxis: Sequence[float],
    parentFramePosition: Sequence[float],
    childFramePosition: Sequence[float],
    *,
    physicsClientId: int = ...,
) -> int: ...
def createCollisionShape(
    shapeType: int,
    *,
    radius: float = ...,
    halfExtents: Sequence[float] = ...,
    height: float = ...,
    vertices: Sequence[Sequence[float]] = ...,
    fileName: str = ...,
    meshScale: Sequence[float] = ...,
    collisionFramePosition: Sequence[float] = ...,
    physicsClientId: int = ...,
) -> int: ...
def createCollisionShapeArray(
    shapeTypes: Sequence[int],
    *,
    radii: Sequence[float] = ...,
    halfExtents: Sequence[Sequence[float]] = ...,
    lengths: Sequence[float] = ...,
    collisionFramePositions: Sequence[Sequence[float]] = ...,
    collisionFrameOrientations: Sequence[Sequence[float]] = ...,
    physicsClientId: int = ...,
) -> int: ...
def createVisualShape(
    shapeType: int,
    *,
    radius: float = ...,
    halfExtents: Sequence[float] = ...,
    length: float = ...,
    vertices: Sequence[Sequence[float]] = ...,
    indices: Sequence[int] = ...,
    normals: Sequence[Sequence[float]] = ...,
    rgbaColor: Sequence[float] = ...,
    fileName: str = ...,
    meshScale: Sequence[float] = ...,
    visualFramePosition: Sequence[float] = ...,
    physicsClientId: int = ...,
) -> int: ...
def changeVisualShape(
    objectUniqueId: int, linkIndex: int, *, rgbaColor: Sequence[float] = ..., physicsClientId: int = ...
) -> None: ...
def createMultiBody(
    baseMass: float = ...,
    baseCollisionShapeIndex: int = ...,
    baseVisualShapeIndex: int = ...,
    basePosition: Sequence[float] = ...,
    baseOrientation: Sequence[float] = ...,
    *,
    linkMasses: Sequence[float] = ...,
    linkCollisionShapeIndices: Sequence[int] = ...,
    linkVisualShapeIndices: Sequence[int] = ...,
    linkPositions: Sequence[Vec3] = ...,
    linkOrientations: Sequence[Vec4] = ...,
    linkInertialFramePositions: Sequence[Vec3] = ...,
    linkInertialFrameOrientations: Sequence[Vec4] = ...,
    linkParentIndices: Sequence[int] = ...,
    linkJointTypes: Sequence[int] = ...,
    linkJointAxis: Sequence[Vec3] = ...,
    flags: int = ...,
    useMaximalCoordinates: int = ...,
    physicsClientId: int = ...,
) -> int: ...
def rayTest(
    rayFromPosition: Sequence[float], rayToPosition: Sequence[float], *, physicsClientId: int = ...
) -> tuple[tuple[int, int, float, Vec3, Vec3], ...]: ...
def getAABB(bodyUniqueId: int, linkIndex: int = ..., physicsClientId: int = ...) -> tuple[Vec3, Vec3]: ...
def getOverlappingObjects(
    aabbMin: Sequence[float], aabbMax: Sequence[float], *, physicsClientId: int = ...
) -> tuple[tuple[int, int], ...]: ...
def removeBody(bodyUniqueId: int, physicsClientId: int = ...) -> None: ...
def getBasePositionAndOrientation(bodyUniqueId: int, physicsClientId: int = ...) -> tuple[Vec3, Vec4]: ...
def resetBasePositionAndOrientation(
    bodyUniqueId: int, posObj: Sequence[float], ornObj: Sequence[float], physicsClientId: int = ...
) -> None: ...
def getBaseVelocity(bodyUniqueId: int, physicsClientId: int = ...) -> tuple[Vec3, Vec3]: ...
def resetBaseVelocity(
    objectUniqueId: int, linearVelocity: Sequence[float], angularVelocity: Sequence[float], physicsClientId: int = ...
) -> None: ...
def getContactPoints(
    bodyA: int = ..., bodyB: int = ..., linkIndexA: int = ..., linkIndexB: int = ..., *, physicsClientId: int = ...
) -> tuple[tuple[int, int, int, int, int, Vec3, Vec3, Vec3, float, float, float, Vec3, float, Vec3], ...]: ...
def getClosestPoints(
    bodyA: int, bodyB: int, distance: float, *, physicsClientId: int = ...
) -> tuple[tuple[int, int, int, int, int, Vec3, Vec3, Vec3, float, float, float, Vec3, float, Vec3], ...]: ...
def applyExternalForce(
    objectUniqueId: int,
    linkIndex: int,
    forceObj: Sequence[float],
    posObj: Sequence[float],
    flags: int,
    *,
    physicsClientId: int = ...,
) -> None: ...
def calculateInverseDynamics(
    bodyUniqueId: int,
    objPositions: Sequence[float],
    objVelocities: Sequence[float],
    objAccelerations: Sequence[float],
    *,
    physicsClientId: int = ...,
) -> tuple[float, ...]: ...
def computeProjectionMatrix(
    left: float, right: float, bottom: float, top: float, nearVal: float, farVal: float, physicsClientId: int = ...
) -> tuple[float, ...]: ...
def getCameraImage(
    width: int,
    height: int,
    viewMatrix: Sequence[float],
    projectionMatrix: Sequence[float],
    *,
    lightDirection: Sequence[float] = ...,
    lightColor: Sequence[float] = ...,
    lightDistance: float = ...,
    shadow: int = ...,
    lightAmbientCoeff: float = ...,
    lightDiffuseCoeff: float = ...,
    lightSpecularCoeff: float = ...,
    renderer: int = ...,
    flags: int = ...,
    physicsClientId: int = ...,
) -> tuple[int, int, NDArray[np.uint8], NDArray[np.float32], object]: ...
