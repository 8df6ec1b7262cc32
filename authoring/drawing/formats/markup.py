"""Text as it may stand in XML and HTML."""

from __future__ import annotations

import re
from html import escape as _escape

_UNFIT = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def escape(text: str) -> str:
    """For element content and attributes; what no XML file may hold becomes a replacement character.

    >>> escape('a < "b"')
    'a &lt; &quot;b&quot;'
    """
    return _escape(_UNFIT.sub("\ufffd", text))
