import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

def dposv(a: _F, b: _F) -> tuple[_F, _F, int]: ...
