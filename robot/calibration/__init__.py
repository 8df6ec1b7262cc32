"""Calibration of cameras and tool at a target: viewpoints, touches, observations and their estimate."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
