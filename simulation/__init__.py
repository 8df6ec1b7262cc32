"""Simulation of a cell: two backends with their items, feed, injected faults, checkpoints and scorer."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
