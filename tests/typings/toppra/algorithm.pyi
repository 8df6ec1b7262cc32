import numpy as np
from numpy.typing import NDArray

from .constraint import Constraint
from .interpolator import AbstractGeometricPath

class TOPPRA:
    def __init__(
        self,
        constraint_list: list[Constraint],
        path: AbstractGeometricPath,
        gridpoints: NDArray[np.float64] | None = ...,
        solver_wrapper: str | None = ...,
        parametrizer: str | None = ...,
    ) -> None: ...
    def compute_trajectory(self, sd_start: float = ..., sd_end: float = ...) -> AbstractGeometricPath | None: ...
