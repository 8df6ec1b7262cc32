"""Recovery: nodes that react to failures by their cause, and bring the arm to safety."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
