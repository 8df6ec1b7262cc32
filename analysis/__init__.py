"""Answers from a log: explanations, comparisons, re-simulation, reports, pictures, exports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
