"""The part of mujoco's interface that picktree_cell uses."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Indices = NDArray[np.int32]
_Numbers = Sequence[float] | _Array

__version__: str

class mjtGeom:
    mjGEOM_PLANE: int
    mjGEOM_BOX: int
    mjGEOM_CYLINDER: int
    mjGEOM_SPHERE: int
    mjGEOM_MESH: int

class mjtIntegrator:
    mjINT_IMPLICITFAST: int

class mjtCone:
    mjCONE_ELLIPTIC: int

class mjtLimited:
    mjLIMITED_FALSE: int

class mjtTrn:
    mjTRN_JOINT: int

class mjtSensor:
    mjSENS_FORCE: int
    mjSENS_TORQUE: int

class mjtObj:
    mjOBJ_SITE: int
    mjOBJ_JOINT: int

class mjtEq:
    mjEQ_JOINT: int

class mjtMeshInertia:
    mjMESH_INERTIA_CONVEX: int

class MjOption:
    timestep: float
    integrator: int
    cone: int
    impratio: float
    gravity: _Numbers

class MjsGeom:
    rgba: _Numbers
    mass: float
    condim: int
    priority: int
    friction: _Numbers
    solref: _Array | Sequence[float]
    solimp: _Numbers

class MjsJoint:
    name: str
    parent: MjsBody
    armature: float
    actfrclimited: int
    damping: _Array
    frictionloss: float
    limited: int

class MjsSite:
    name: str

class MjsBody:
    name: str
    parent: MjsBody
    bodies: Iterable[MjsBody]
    pos: _Array | Sequence[float]
    quat: _Array | Sequence[float]
    mass: float
    inertia: _Array
    fullinertia: _Array
    geoms: Iterable[MjsGeom]
    def first_body(self) -> MjsBody | None: ...
    def find_all(self, kind: str) -> list[MjsBody]: ...
    def add_body(self, *, name: str, pos: _Numbers, quat: _Numbers) -> MjsBody: ...
    def add_freejoint(self, *, name: str) -> MjsJoint: ...
    def add_geom(
        self,
        *,
        type: int,
        name: str = ...,
        size: _Numbers = ...,
        pos: _Numbers = ...,
        group: int = ...,
        meshname: str = ...,
    ) -> MjsGeom: ...
    def add_site(self, *, name: str, pos: _Numbers = ..., quat: _Numbers = ...) -> object: ...

class MjSpec:
    option: MjOption
    worldbody: MjsBody
    bodies: Iterable[MjsBody]
    joints: Iterable[MjsJoint]
    sites: Iterable[MjsSite]
    actuators: Iterable[object]
    equalities: Sequence[object]
    keys: Iterable[object]
    sensors: Iterable[object]
    @staticmethod
    def from_file(path: str) -> MjSpec: ...
    @staticmethod
    def from_string(text: str, *, assets: Mapping[str, bytes]) -> MjSpec: ...
    def body(self, name: str) -> MjsBody: ...
    def joint(self, name: str) -> MjsJoint: ...
    def copy(self) -> MjSpec: ...
    def to_xml(self) -> str: ...
    def delete(self, element: object) -> None: ...
    def add_actuator(self, *, name: str, target: str, trntype: int = ...) -> object: ...
    def add_exclude(self, *, bodyname1: str, bodyname2: str) -> object: ...
    def add_sensor(self, *, name: str, type: int, objtype: int, objname: str) -> object: ...
    def add_equality(
        self, *, type: int, name1: str, name2: str, objtype: int, data: _Numbers, solref: _Numbers
    ) -> object: ...
    def add_mesh(self, *, name: str, uservert: Sequence[float], inertia: int) -> object: ...
    def compile(self) -> MjModel: ...

class _Named:
    id: int
    name: str
    qposadr: _Indices
    dofadr: _Indices

class _Placed:
    xpos: _Array
    xmat: _Array

class _Global:
    offwidth: int
    offheight: int

class _Map:
    znear: float
    zfar: float

class _Headlight:
    ambient: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    specular: NDArray[np.float32]

class _Visual:
    global_: _Global
    map: _Map
    headlight: _Headlight

class _Statistic:
    extent: float

class MjvGLCamera:
    pos: NDArray[np.float32]
    forward: NDArray[np.float32]
    up: NDArray[np.float32]
    frustum_center: float
    frustum_width: float
    frustum_bottom: float
    frustum_top: float
    frustum_near: float
    frustum_far: float

class MjvScene:
    camera: Sequence[MjvGLCamera]

class MjvCamera:
    def __init__(self) -> None: ...

class Renderer:
    scene: MjvScene
    def __init__(self, model: MjModel, height: int, width: int) -> None: ...
    def update_scene(self, data: MjData, camera: MjvCamera) -> None: ...
    def render(self) -> NDArray[np.uint8] | NDArray[np.float32]: ...
    def enable_depth_rendering(self) -> None: ...
    def disable_depth_rendering(self) -> None: ...

class FatalError(RuntimeError): ...

class MjModel:
    vis: _Visual
    stat: _Statistic
    nv: int
    nu: int
    ngeom: int
    geom_bodyid: _Indices
    geom_matid: _Indices
    geom_rgba: NDArray[np.float32]
    mat_rgba: NDArray[np.float32]
    jnt_bodyid: _Indices
    geom_type: _Indices
    geom_size: _Array
    geom_dataid: _Indices
    body_geomadr: _Indices
    body_geomnum: _Indices
    body_subtreemass: _Array
    mesh_vertadr: _Indices
    mesh_vertnum: _Indices
    mesh_vert: NDArray[np.float32]
    def joint(self, name: str) -> _Named: ...
    def body(self, name: str) -> _Named: ...
    def site(self, name: str) -> _Named: ...

class MjData:
    qpos: _Array
    qvel: _Array
    ctrl: _Array
    qfrc_bias: _Array
    sensordata: _Array
    xpos: _Array
    xmat: _Array
    geom_xpos: _Array
    geom_xmat: _Array
    site_xpos: _Array
    site_xmat: _Array
    def __init__(self, model: MjModel) -> None: ...
    def body(self, name: str) -> _Placed: ...
    def site(self, name: str) -> _Placed: ...

def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_step(m: MjModel, d: MjData) -> None: ...
def mj_fullM(m: MjModel, d: MjData, dst: _Array) -> None: ...
def mj_jacSubtreeCom(m: MjModel, d: MjData, jacp: _Array, body: int) -> None: ...
def mju_mulQuat(res: _Array, quat1: _Array, quat2: _Numbers) -> None: ...
def mju_rotVecQuat(res: _Array, vec: _Numbers, quat: _Array) -> None: ...
def mju_mat2Quat(quat: _Array, mat: _Array) -> None: ...
def mju_quat2Mat(res: _Array, quat: _Array) -> None: ...
def mj_multiRay(
    m: MjModel,
    d: MjData,
    pnt: _Array,
    vec: _Array,
    geomgroup: NDArray[np.uint8],
    flg_static: bool,
    bodyexclude: int,
    geomid: _Indices,
    dist: _Array,
    normal: _Array,
    nray: int,
    cutoff: float,
) -> None: ...
