"""Part of fast-simplification that is used."""

import numpy as np
from numpy.typing import NDArray

def simplify(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    *,
    target_count: int,
    agg: float,
    return_collapses: bool,
    preserve_border: bool,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]: ...
