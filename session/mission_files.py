"""The files of a mission as a log keeps them: each under a name from which it can be served again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..trees.mission import Mission, Plugin
from ..trees.mission_files import name_of


@dataclass(frozen=True, slots=True)
class Attachment:
    name: str
    content: str | bytes
    media_type: str
    source: Path | None = None
    """The file that it was read from."""

    @property
    def data(self) -> bytes:
        return self.content.encode() if isinstance(self.content, str) else self.content


def mission_files(mission: Mission) -> Iterator[Attachment]:
    """The mission, what it includes under the names by which it does so, and the sources of its plug-ins:
    `plugin/wave.py` lies beside it, `module/a.b.py` is installed."""
    yield Attachment("mission.yaml", mission.text, "application/yaml", mission.document.path)
    folder = mission.document.path.parent
    for document in mission.included:
        name = f"include/{name_of(document.path, folder)}"
        yield Attachment(name, document.text, "application/yaml", document.path)
    folder = folder.resolve()
    for plugin in mission.sources:
        if plugin.file is not None:
            yield Attachment(_name(plugin, plugin.file, folder), plugin.source, "text/x-python", plugin.file)


def plugin_versions(mission: Mission) -> dict[str, str]:
    """Versions of the distributions that its installed plug-ins come from, by name."""
    known = (plugin.distribution.rpartition(" ") for plugin in mission.sources if plugin.distribution)
    return {name: version for name, _, version in known}


def _name(plugin: Plugin, file: Path, folder: Path) -> str:
    if not plugin.name.endswith(".py"):
        return f"module/{plugin.name}.py"
    beside = file.is_relative_to(folder)
    return f"plugin/{file.relative_to(folder).as_posix() if beside else plugin.name}"
