import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

def solve_banded(l_and_u: tuple[int, int], ab: _F, b: _F) -> _F: ...
