"""Studio: a local web application over a folder with missions, scenes, plans and runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
