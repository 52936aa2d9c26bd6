"""The error that every reader of files, options and settings raises."""


class ConfigError(ValueError):
    """An error in a file, an option or an override; the message names place, key, value and what is allowed."""
