# for other rooms
from .reader import ChannelInfo as ChannelInfo, McapReader as McapReader, RawMessage as RawMessage
from .writer import McapFile as McapFile, is_written as is_written, require_free_space as require_free_space
