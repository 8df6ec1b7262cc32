"""The plug-ins of a mission as a log keeps them: sources under names of their own, and versions."""

from __future__ import annotations

from pathlib import Path

from ..trees.mission import Mission
from ..trees.plugins import Plugin


def plugin_sources(mission: Mission) -> dict[str, bytes]:
    """Sources of the mission's plug-ins: `plugin/wave.py` lies beside it, `module/a.b.py` is installed."""
    folder = mission.document.path.parent.resolve()
    return {_name(plugin, plugin.file, folder): plugin.source for plugin in mission.sources if plugin.file}


def plugin_versions(mission: Mission) -> dict[str, str]:
    """Versions of the distributions that its installed plug-ins come from, by name."""
    known = (plugin.distribution.rpartition(" ") for plugin in mission.sources if plugin.distribution)
    return {name: version for name, _, version in known}


def _name(plugin: Plugin, file: Path, folder: Path) -> str:
    if not plugin.name.endswith(".py"):
        return f"module/{plugin.name}.py"
    beside = file.is_relative_to(folder)
    return f"plugin/{file.relative_to(folder).as_posix() if beside else plugin.name}"
