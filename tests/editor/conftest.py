"""One language server for all tests of the editor."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ..needs import packages
from .language_server import LanguageServer

HERE = Path(__file__).parent
PROGRAM = HERE / "node/node_modules/yaml-language-server/bin/yaml-language-server"


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LanguageServer]:
    """yaml-language-server, the one inside VS Code's YAML extension and of most other editors."""
    packages("editor").require()
    running = LanguageServer(["node", str(PROGRAM), "--stdio"], tmp_path_factory.mktemp("editor"))
    yield running
    running.close()
