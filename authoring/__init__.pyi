from .check import check_mission as check_mission
from .mission_chart import chart_of_file as chart_of_file
from .svg_drawing import svg as svg

# for other rooms
from . import (
    drawing as drawing,
    file_kinds as file_kinds,
    mission_chart as mission_chart,
    svg_drawing as svg_drawing,
)
from .check import MissionCheck as MissionCheck
from .file_kinds import CHECKS as CHECKS, file_schema as file_schema, mission_faults as mission_faults
from .html_drawing import chart_json as chart_json
from .mission_chart import chart as chart
from .text_drawing import DEFAULT_COLUMNS as DEFAULT_COLUMNS, text as text
