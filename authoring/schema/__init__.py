"""JSON Schemas and references of the files that people write, generated from their declarations."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
