"""Text in Markdown."""


def escaped(text: str) -> str:
    """Return a text as Markdown that shows it as it is, on one line, also in a table."""
    for character in "\\`*_<>|[]":
        text = text.replace(character, f"\\{character}")
    return " ".join(text.split())
