from .report import write_report as write_report

# for other rooms
from . import stage_panel as stage_panel
from .body_motion import row as row
from .packing import Packable as Packable, Section as Section, pack as pack
