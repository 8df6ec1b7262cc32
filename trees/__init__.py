"""Behaviour-tree language of missions: node declarations, control nodes, loader, registry, runner."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
