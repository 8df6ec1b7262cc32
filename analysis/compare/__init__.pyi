from .alignment import align as align
from .message_differences import first_difference as first_difference
from .run_diff import diff as diff

# for other rooms
from . import message_differences as message_differences, run_diff as run_diff
from .alignment import Alignment as Alignment, Divergence as Divergence
from .run_outcome import RunOutcome as RunOutcome, outcome_of as outcome_of
