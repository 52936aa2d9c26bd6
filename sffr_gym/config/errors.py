"""The error that every reader of files, options and settings raises, and how it shows texts of others."""


class ConfigError(ValueError):
    """An error in a file, an option or an override; the message names place, key, value and what is allowed."""


def one_line(text: str, most: int = 200) -> str:
    """Return a text of others as a message shows it: what would break the line or steer a terminal is escaped.

    Args:
        text: any.
        most: characters; a longer text is cut.
    """
    shown = text if text.isprintable() else repr(text)[1:-1]
    return shown if len(shown) <= most else f"{shown[: most - 3]}..."
