# for other rooms
from . import (
    calibration_targets as calibration_targets,
    observations as observations,
    target_detection as target_detection,
)
from .estimation import (
    CalibrationEstimate as CalibrationEstimate,
    CameraEstimate as CameraEstimate,
    ToolEstimate as ToolEstimate,
    estimate as estimate,
)
from .viewpoints import Viewpoint as Viewpoint, viewpoints as viewpoints
