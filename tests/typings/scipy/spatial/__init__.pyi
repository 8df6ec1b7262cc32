import numpy as np
from numpy.typing import ArrayLike, NDArray

class ConvexHull:
    vertices: NDArray[np.intp]
    simplices: NDArray[np.intp]
    equations: NDArray[np.float64]
    volume: float
    area: float
    def __init__(self, points: ArrayLike) -> None: ...
