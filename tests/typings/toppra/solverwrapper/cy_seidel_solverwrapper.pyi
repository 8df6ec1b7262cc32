import numpy as np
from numpy.typing import NDArray

from ..constraint import Constraint

_F = NDArray[np.float64]

class seidelWrapper:
    def __init__(
        self, constraint_list: list[Constraint], path: object, path_discretization: _F, solve_lp1d: int = ...
    ) -> None: ...
    def setup_solver(self) -> None: ...
    def close_solver(self) -> None: ...
    def solve_stagewise_optim(
        self,
        i: int,
        H: None,
        g: _F,
        x_min: float,
        x_max: float,
        x_next_min: float,
        x_next_max: float,
    ) -> list[float]: ...
