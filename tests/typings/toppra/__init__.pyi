from . import algorithm as algorithm
from . import constraint as constraint
from .interpolator import AbstractGeometricPath as AbstractGeometricPath
from .interpolator import SplineInterpolator as SplineInterpolator
