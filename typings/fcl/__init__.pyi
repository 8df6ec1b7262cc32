from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

class Transform:
    def __init__(self, rotation: _F, translation: _F) -> None: ...

class CollisionGeometry: ...

class Box(CollisionGeometry):
    def __init__(self, x: float, y: float, z: float) -> None: ...

class Cylinder(CollisionGeometry):
    def __init__(self, radius: float, lz: float) -> None: ...

class Sphere(CollisionGeometry):
    def __init__(self, radius: float) -> None: ...

class Convex(CollisionGeometry):
    def __init__(self, vertices: _F, num_faces: int, faces: NDArray[np.int64]) -> None: ...

class CollisionObject:
    def __init__(self, geometry: CollisionGeometry, transform: Transform | None = ...) -> None: ...
    def setTransform(self, transform: Transform) -> None: ...

class DistanceRequest:
    def __init__(self, enable_nearest_points: bool = ..., enable_signed_distance: bool = ...) -> None: ...

class DistanceResult:
    min_distance: float
    nearest_points: Sequence[_F]
    def __init__(self) -> None: ...

def distance(
    a: CollisionObject, b: CollisionObject, request: DistanceRequest, result: DistanceResult
) -> float: ...
