import enum

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

class DiscretizationType(enum.Enum):
    Collocation = 0
    Interpolation = 1

class Constraint: ...

class JointVelocityConstraint(Constraint):
    def __init__(self, vlim: _F) -> None: ...

class JointAccelerationConstraint(Constraint):
    def __init__(self, alim: _F, discretization_scheme: DiscretizationType = ...) -> None: ...

class LinearConstraint(Constraint):
    identical: bool
    dof: int
    def __init__(self) -> None: ...
