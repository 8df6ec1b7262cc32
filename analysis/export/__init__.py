"""A run's log as tables (csv, Parquet) and as a Rerun recording."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
