from .rehearsal import rehearse as rehearse, rehearse_files as rehearse_files

# for other rooms
from . import rehearsal as rehearsal
from .case_checks import check_cases as check_cases
from .cases import CasesFile as CasesFile
from .rehearsal import Rehearsal as Rehearsal, to_json as to_json
