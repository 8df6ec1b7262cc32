"""Why a run ended as it did: failures, what recovery made of them, the items' stories."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
