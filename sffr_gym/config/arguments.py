"""Arguments of functions, checked as the values of a file are."""

from typing import Any

from sffr_gym.config.strict_yaml import ModelT, build


def check_arguments(model: type[ModelT], **values: Any) -> ModelT:
    """Return the model of some arguments; NumPy's numbers are taken as Python's.

    Raises:
        ConfigError: one line for each that is not valid; it names the argument.
    """
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in values.items()}
    return build(model, plain, lambda key: "argument")
