from .world import World as World

# for other rooms
from . import operator_desk as operator_desk
from .vision import CapturedImage as CapturedImage, Look as Look, Vision as Vision
from .world import (
    HandlingParameters as HandlingParameters,
    Handover as Handover,
    PlaceCandidate as PlaceCandidate,
)
