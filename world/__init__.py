"""World model of the robot: values, shapes, belief, causes, events, protocols of the hardware."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
