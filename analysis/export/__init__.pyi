# for other rooms
from . import table_files as table_files
from .run_export import export as export
from .table_files import columns as columns, row_type as row_type
from .viewer_layout import LAYOUT_FILE as LAYOUT_FILE
