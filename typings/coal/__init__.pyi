import numpy as np
from numpy.typing import NDArray

class AABB:
    min_: NDArray[np.float64]
    max_: NDArray[np.float64]

class CollisionGeometry:
    aabb_local: AABB
    def computeLocalAABB(self) -> None: ...

class ConvexBase(CollisionGeometry):
    def points(self) -> NDArray[np.float64]: ...
    @staticmethod
    def convexHull(points: StdVec_Vec3s, keep_triangles: bool, command: str) -> ConvexBase: ...

class Convex(ConvexBase): ...

class Box(CollisionGeometry):
    def __init__(self, x: float, y: float, z: float) -> None: ...

class Cylinder(CollisionGeometry):
    def __init__(self, radius: float, height: float) -> None: ...

class Sphere(CollisionGeometry):
    def __init__(self, radius: float) -> None: ...

class BVHModelOBBRSS(CollisionGeometry):
    convex: ConvexBase
    def buildConvexHull(self, keep_triangles: bool, command: str) -> None: ...

class MeshLoader: ...
class CachedMeshLoader(MeshLoader): ...

class StdVec_Vec3s:
    def append(self, point: NDArray[np.float64]) -> None: ...

class Transform3s:
    def __init__(self, rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> None: ...

class CollisionRequest:
    security_margin: float
    def __init__(self) -> None: ...

class CollisionResult:
    def __init__(self) -> None: ...

def collide(
    a: CollisionGeometry,
    a_in_world: Transform3s,
    b: CollisionGeometry,
    b_in_world: Transform3s,
    request: CollisionRequest,
    result: CollisionResult,
) -> int: ...

class DistanceRequest:
    enable_signed_distance: bool
    def __init__(self) -> None: ...

class DistanceResult:
    def __init__(self) -> None: ...
    def getNearestPoint1(self) -> NDArray[np.float64]: ...
    def getNearestPoint2(self) -> NDArray[np.float64]: ...

def distance(
    a: CollisionGeometry,
    a_in_world: Transform3s,
    b: CollisionGeometry,
    b_in_world: Transform3s,
    request: DistanceRequest,
    result: DistanceResult,
) -> float: ...
