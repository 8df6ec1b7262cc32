from .debugger import Debugger as Debugger, DebuggerStop as DebuggerStop
from .observer import Observer as Observer, PresetAnswers as PresetAnswers
from .resumption import ResumeRequest as ResumeRequest, Resumption as Resumption
from .run_recipe import RunRequest as RunRequest
from .session import Session as Session

# for other rooms
from . import (
    attach_socket as attach_socket,
    environment as environment,
    mission_edits as mission_edits,
    run_recipe as run_recipe,
)
from .arithmetic_probe import arithmetic as arithmetic
from .cell import CellSession as CellSession
from .cell_unpacking import CellUnpacking as CellUnpacking
from .debugger import Breakpoint as Breakpoint, When as When
from .environment import sources as sources, versions as versions
from .execution import Execution as Execution, assemble_world as assemble_world
from .live_view import LiveServer as LiveServer
from .observer import Interrupter as Interrupter, WallClockPacer as WallClockPacer
from .recorded_recipe import (
    RecordedRun as RecordedRun,
    simulated_messages as simulated_messages,
    tally_of as tally_of,
)
from .run_tally import RunCounters as RunCounters
from .session import frozen_before_runs as frozen_before_runs
from .session_recording import LOG_FILE_NAME as LOG_FILE_NAME, LastMessages as LastMessages
