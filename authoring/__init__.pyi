from .check import check_mission as check_mission

# for other rooms
from . import (
    drawing as drawing,
    file_kinds as file_kinds,
    mission_chart as mission_chart,
    svg_drawing as svg_drawing,
)
from .check import MissionCheck as MissionCheck
from .drawing import text as text
from .file_kinds import CHECKS as CHECKS, file_schema as file_schema, mission_faults as mission_faults
from .mission_chart import chart as chart
from .svg_drawing import svg as svg
