import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

def dposv(a: _F, b: _F) -> tuple[_F, _F, int]: ...
def dgtsv(dl: _F, d: _F, du: _F, b: _F) -> tuple[_F, _F, _F, _F, int]: ...
