# for other rooms
from . import node_reference as node_reference
from .mission import (
    MissionSpecifics as MissionSpecifics,
    any_mission as any_mission,
    mission_files as mission_files,
    mission_schema as mission_schema,
    one_mission as one_mission,
    patch as patch,
    patched as patched,
)
from .node_reference import markdown as markdown
from .pydantic_schema import model_schema as model_schema
from .python_stub import stub as stub
from .reference_page import file_reference as file_reference
from .schema_parts import (
    Schema as Schema,
    belonging as belonging,
    header as header,
    ref as ref,
    schema as schema,
    schemas as schemas,
    to_text as to_text,
)
