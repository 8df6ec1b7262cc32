"""Setting up a cell: robot files from URDFs, calibration, plans tried in a scene."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
