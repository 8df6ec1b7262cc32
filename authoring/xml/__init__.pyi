from .mission_export import mission_to_xml as mission_to_xml

# for other rooms
from .conversion import convert_all as convert_all, read_files as read_files
from .mission_import import ImportOptions as ImportOptions, check_xml as check_xml
from .source import XmlText as XmlText
