from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

def linear_sum_assignment(
    cost_matrix: ArrayLike, maximize: bool = False
) -> tuple[NDArray[np.intp], NDArray[np.intp]]: ...

class OptimizeResult:
    x: NDArray[np.float64]
    cost: float
    success: bool

def least_squares(
    fun: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    x0: ArrayLike,
    *,
    jac: str = "2-point",
    loss: str = "linear",
    f_scale: float = 1.0,
    x_scale: ArrayLike = 1.0,
    diff_step: ArrayLike | None = None,
    xtol: float = 1e-8,
    ftol: float = 1e-8,
) -> OptimizeResult: ...
def nnls(A: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]: ...
