from .backend import KinematicHardware as KinematicHardware
