"""Strict YAML: files and dotted overrides become validated models, or an error that says where and what is allowed.

Knows nothing of the robot: ``sections.py`` and ``params.py`` have its models, other packages their own.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from sffr_gym.config.errors import ConfigError as ConfigError
from sffr_gym.config.errors import one_line
from sffr_gym.config.reading import read_text
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.config.yaml_text import MOST_YAML, UNREADABLE, Key, explain_unreadable, parse_yaml

Where = Callable[[Key], str]  # the source of the value at a key: a file and its line, or an override
ModelT = TypeVar("ModelT", bound=BaseModel)

SHIPPED = "sffr.yaml"
TAG = "form: "  # start of the tags of pydantic unions, which are no part of a key
CHECK = "check"  # type of the errors that the models' own checks find; their message is complete
_REASONS = {
    "bool_type": "must be true or false",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "string_type": "must be a text",
    "string_too_short": "must not be empty",
    "string_too_long": "must have at most {max_length} characters",
    "tuple_type": "must be a list",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "finite_number": "must be finite",
    "literal_error": "must be {expected}",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_short": "must have at least {min_length} entry",
    "too_long": "must have {max_length} entries, has {actual_length}",
}


def config_dir() -> Path:
    """Return the folder of the shipped files: inside an installed package, or beside the package in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def find_config(name: str | os.PathLike[str], folder: str = "") -> Path:
    """Return the shipped file of a name in ``folder``, or else the file at a path.

    A text says that it is a path by a separator or an ending: ``./lqr`` and ``lqr.yaml`` are files, ``lqr`` is the
    shipped one whatever lies in the working directory, and so is ``lqr.yaml`` if nothing of that name lies there.
    Shipped names may lead into a folder below, ``practice/mixed`` in ``scenarios``.

    Raises:
        ConfigError: if there is neither, or for what is no name.
    """
    if not isinstance(name, str | os.PathLike):
        raise ConfigError(f"{one_line(repr(name))}: must be the path of a file or the name of a shipped one")
    text, shipped_files = os.fspath(name), config_dir() / folder
    files = shipped_files.glob("**/*.yaml" if folder else "*.yaml")
    shipped = {file.relative_to(shipped_files).with_suffix("").as_posix(): file for file in files}
    if isinstance(name, str) and text in shipped:
        return shipped[text]
    path = Path(text)
    is_path = not isinstance(name, str) or len(path.parts) > 1 or path.suffix != "" or text.startswith(("./", ".\\"))
    if is_path and _is_there(path):
        return path
    if text.removesuffix(".yaml") in shipped:
        return shipped[text.removesuffix(".yaml")]
    hint = did_you_mean(path.stem, shipped)
    if not is_path and path.parts and _is_there(path):
        hint = f"; for the file of that name write ./{one_line(text)}"
    raise ConfigError(f"{one_line(text)}: no such file{hint} (shipped: {', '.join(sorted(shipped))})")


def _is_there(path: Path) -> bool:
    """Say whether anything lies at a path; a name that no file can have is none."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def read_mapping(file: Path) -> tuple[dict[str, Any], Where]:
    """Return the mapping in a YAML file and a function that names the file and line of a key.

    Raises:
        ConfigError: if the file cannot be read or is too large, is no valid YAML, gives a key twice or holds no
            mapping.
    """
    text = read_text(file, MOST_YAML)
    try:
        value, lines = parse_yaml(text)
    except UNREADABLE as error:
        mark = getattr(error, "problem_mark", None)
        raise ConfigError(f"{file}{f':{mark.line + 1}' if mark else ''}: {explain_unreadable(error)}") from None
    if not isinstance(value, dict):
        raise ConfigError(f"{file}: must hold a mapping of keys to values, has {_show(value)}")

    def where(key: Key) -> str:
        known = [key[:n] for n in range(len(key), 0, -1) if key[:n] in lines]
        return f"{file}:{lines[known[0]]}" if known else str(file)

    return value, where


def merge(old: Any, new: Any) -> Any:
    """Return ``old`` with the keys of ``new`` put over it: mappings recursively, everything else whole."""
    if not (isinstance(old, dict) and isinstance(new, dict)):
        return new
    return old | {key: merge(old.get(key), value) for key, value in new.items()}


def apply_overrides(data: dict[str, Any], assignments: Sequence[str]) -> tuple[dict[str, Any], Where]:
    """Return ``data`` with assignments such as "panel.EI=25" made in turn, and a function that names a key's.

    Raises:
        ConfigError: if an assignment is not of that form, or its key leads to a place that is not there.
    """
    keys: dict[str, Key] = {}
    for assignment in assignments:
        if not isinstance(assignment, str):
            raise ConfigError(f"override {assignment!r}: must be a text such as 'panel.EI=25', each by itself")
        source = f"override '{one_line(assignment)}'"
        dotted, equals, text = assignment.partition("=")
        names = dotted.strip().split(".")
        if not equals or not all(names):
            raise ConfigError(f"{source}: must be key=value, such as panel.EI=25")
        try:
            value, _ = parse_yaml(text)
        except UNREADABLE as error:
            raise ConfigError(f"{source}: {explain_unreadable(error)}") from None
        keys[source], data = _assign(data, names, value, source)

    def where(key: Key) -> str:
        related = [source for source, own in keys.items() if own[: len(key)] == key[: len(own)]]
        return related[-1] if related else ", ".join(keys)

    return data, where


def build(model: type[ModelT], data: dict[str, Any], where: Where) -> ModelT:
    """Return the model with these data.

    Raises:
        ConfigError: if anything is unknown, missing or not allowed; one line for each error.
    """
    try:
        return model.model_validate(data)
    except ValidationError as invalid:
        messages, errors = {}, invalid.errors(include_url=False)
        keys = [tuple(part for part in error["loc"] if not str(part).startswith(TAG)) for error in errors]
        for key, error in zip(keys, errors, strict=True):
            # pydantic does not count an invalid entry, which has a message of its own
            if error["type"] == "too_short" and any(own[:-1][: len(key)] == key for own in keys if own):
                continue
            short = error["type"] == "missing" and isinstance(key[-1], int)  # the last one tells the length
            messages[(key[:-1], "length") if short else (key, error["type"])] = _explain(model, key, error, where)
        raise ConfigError("\n".join(messages.values())) from None


def load(model: type[ModelT], path: str | os.PathLike[str], folder: str) -> ModelT:
    """Return the model with the data of a user's file, or of the shipped one of that name in a folder.

    Raises:
        ConfigError: if there is no such file, or its content is not valid.
    """
    return build(model, *read_mapping(find_config(path, folder)))


def check_error(reason: str) -> PydanticCustomError:
    """Return what a model's own check raises, for a message that says what a value must be."""
    return PydanticCustomError(CHECK, "{reason}", {"reason": reason})


def _assign(data: Any, names: Sequence[str], value: Any, source: str, done: Key = ()) -> tuple[Key, Any]:
    """Return the key that ``names`` spell in ``data``, and a copy of ``data`` with the value merged in there."""
    if not names:
        return done, merge(data, value)
    name, here = names[0], one_line(".".join(map(str, done)))
    if isinstance(data, list):
        if not (name.isascii() and name.isdecimal() and len(name) < 10 and int(name) < len(data)):
            raise ConfigError(
                f"{source}: {here}.{one_line(name)}: no such entry; '{here}' has {len(data)}, counted from 0"
            )
        key, child = _assign(data[int(name)], names[1:], value, source, (*done, int(name)))
        return key, [*data[: int(name)], child, *data[int(name) + 1 :]]
    if not isinstance(data, dict):
        raise ConfigError(f"{source}: {here}.{one_line(name)}: there are no keys in '{here}', which is {_show(data)}")
    # An unknown key is put in all the same: the validation reports it with its nearest valid name.
    key, child = _assign(data.get(name, None if len(names) == 1 else {}), names[1:], value, source, (*done, name))
    return key, data | {name: child}


def _explain(model: type[BaseModel], key: Key, error: Any, where: Where) -> str:
    """Return the line for one error that pydantic found: place, key, value, what is allowed."""
    kind, dotted = error["type"], one_line(".".join(map(str, key)))
    section, field = _resolve(model, key)
    about = f" ({field.description})" if field and field.description else ""
    if kind == "extra_forbidden":
        known = list(section.model_fields) if section else []
        elsewhere = [path for path in _dotted_names(model) if path.rpartition(".")[2].lower() == str(key[-1]).lower()]
        outermost = [path for path in elsewhere if path.count(".") == min(each.count(".") for each in elsewhere)]
        hint = did_you_mean(str(key[-1]), known) or (f"; did you mean '{outermost[0]}'?" if len(outermost) == 1 else "")
        return f"{where(key)}: {dotted}: unknown key{hint} (known: {', '.join(known)})"
    if kind == "missing" and isinstance(key[-1], int):
        key, dotted = key[:-1], ".".join(map(str, key[:-1]))
        reason = f"must have {error['loc'][-1] + 1} entries, has {len(error['input'])}"
    elif kind == "missing":
        return f"{where(key)}: {dotted}: missing{about}"
    elif kind == "invalid_key":
        return f"{where(key)}: {dotted}: keys must be texts"
    elif kind == CHECK:
        reason, about = error["msg"], ""
    else:
        reason = _REASONS[kind].format(**error.get("ctx", {})) if kind in _REASONS else error["msg"]
    return f"{where(key)}: {dotted} = {_show(error['input'])}: {reason}{about}"


def _resolve(model: type[BaseModel], key: Key) -> tuple[type[BaseModel] | None, FieldInfo | None]:
    """Return the model that the last name of a key belongs to, and its field there if it has one."""
    section: type[BaseModel] | None = model
    inner, field = section, None
    for part in key:
        if not isinstance(part, int):
            section = inner
            field = section.model_fields.get(part) if section else None
            inner = _submodel(field.annotation) if field else None
    return section, field


def _submodel(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for found in map(_submodel, get_args(annotation)) if found), None)


def _dotted_names(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield prefix + name
        inner = _submodel(field.annotation)
        if inner:
            yield from _dotted_names(inner, f"{prefix}{name}.")


def _show(value: Any) -> str:
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else repr(_to_list(value))
    return text if len(text) <= 60 else f"{text[:57]}..."


def _to_list(value: Any) -> Any:
    return [_to_list(entry) for entry in value] if isinstance(value, list | tuple) else value
