"""Robot cell as skills use it: the World, cameras, motion parameters, the operator, handovers between
skills."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
