"""Skills that come with picktree: leaves that move the robot or look through its cameras."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
