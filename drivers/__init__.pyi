# for other rooms
from . import protocol as protocol
from .external_hardware import ExternalHardware as ExternalHardware
from .external_recogniser import ExternalRecogniser as ExternalRecogniser
from .measurement import (
    RobotMeasurement as RobotMeasurement,
    measurement_path as measurement_path,
    read_measurement as read_measurement,
    write_measurement as write_measurement,
)
from .shadow import ShadowHardware as ShadowHardware, shadow_summary as shadow_summary
