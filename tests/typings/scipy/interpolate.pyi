import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

class CubicSpline:
    c: _F
    def __init__(self, x: _F, y: _F, axis: int = ..., bc_type: str = ...) -> None: ...
    def __call__(self, x: _F | float, nu: int = ...) -> _F: ...
