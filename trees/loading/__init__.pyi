from .loader import load_mission as load_mission, parse_mission as parse_mission
from .registry import NodeRegistry as NodeRegistry

# for other rooms
from .grammar import (
    ChildNames as ChildNames,
    FOREIGN_WORDS as FOREIGN_WORDS,
    NAME_PATTERN as NAME_PATTERN,
    foreign_word as foreign_word,
)
from .loader import (
    IncludeReader as IncludeReader,
    MissionReadResult as MissionReadResult,
    SceneNames as SceneNames,
    examine as examine,
    load_surroundings as load_surroundings,
    read_mission as read_mission,
    required_mission as required_mission,
    scene_names as scene_names,
)
from .plugin import PLUGINS_VARIABLE as PLUGINS_VARIABLE, load_plugin as load_plugin
from .plugin_import import GROUP as GROUP, PluginError as PluginError
from .port_reader import TreePorts as TreePorts
from .registry import installed_entries as installed_entries
