import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from .browser import Chromium


@pytest.fixture(scope="session")
def sample() -> ModuleType:
    """The made-up run of `sample.py`: `record(path)`, `told(path)` and their parts."""
    spec = importlib.util.spec_from_file_location("logs_sample", Path(__file__).parent / "sample.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def log_path(sample: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished log; do not change the file."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    sample.record(path)
    return path


@pytest.fixture(scope="session")
def chromium() -> Iterator[Chromium]:
    """For tests with `browser.NEEDED`."""
    browser = Chromium()
    yield browser
    browser.close()
