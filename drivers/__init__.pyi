# for other rooms
from . import protocol as protocol
from .external_hardware import ExternalHardware as ExternalHardware
