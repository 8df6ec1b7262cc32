"""Commissioning of a cell: robot files from URDFs, calibration, trial plans in a scene."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
