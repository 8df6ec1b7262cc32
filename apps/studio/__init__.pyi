# for other rooms
from .server import serve as serve
