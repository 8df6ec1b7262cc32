# for other rooms
from .app import answer as answer
