from .recorder import Recorder as Recorder

# for other rooms
from . import foxglove_messages as foxglove_messages
from .foxglove_messages import (
    UNKNOWN_COLOUR as UNKNOWN_COLOUR,
    WORLD as WORLD,
    decode_colour as decode_colour,
    decode_depth as decode_depth,
    require_picture_name as require_picture_name,
    write_picture as write_picture,
)
from .interrupts import Interrupts as Interrupts
from .journal_records import belief_record as belief_record
from .recorder import Listener as Listener, RecordingState as RecordingState
from .true_state import (
    WHOLE_STATE_PERIOD as WHOLE_STATE_PERIOD,
    fold_states as fold_states,
    read_state as read_state,
)
