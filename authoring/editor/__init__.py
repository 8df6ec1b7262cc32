"""Editor support without a protocol: completion, hover, definition, rename and quick fixes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
