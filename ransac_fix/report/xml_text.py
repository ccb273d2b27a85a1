"""Text in XML."""

import re

# What XML 1.0 cannot hold, not even escaped.
_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def cleaned(text: str) -> str:
    """Return a text with a replacement character for each that XML cannot hold."""
    return _FORBIDDEN.sub("\ufffd", text)
