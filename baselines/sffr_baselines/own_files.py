"""Laws of your own by name: ``mine.py:MyLaw``, ``package.module:MyLaw``, with settings ``,key=value`` behind.

A file named in this way is run, as ``python mine.py`` would; nothing else that a command reads ever is.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from sffr_baselines.own_law import FAULTS, ControlLaw, OwnPolicy, UnfitError, describe_error
from sffr_gym.config.files import short_hash
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.config.yaml_text import UNREADABLE, parse_yaml

_NAME = re.compile(r"(?P<where>.+\.py|[A-Za-z_]\w*(\.[A-Za-z_]\w*)*):(?P<law>[A-Za-z_]\w*)(?P<settings>(,.*)?)", re.S)
_SETTING = re.compile(r",(?=\s*[A-Za-z_]\w*\s*=)")  # commas between settings, not those within a list


class OwnName(NamedTuple):
    """What a name of a law says."""

    where: str  #: file or module
    law: str  #: name of its class
    settings: str  #: as written behind it, without the first comma


def own_name(name: str) -> OwnName | None:
    """Return the parts of the name of a law of your own; None for any other name."""
    found = _NAME.fullmatch(name)
    return OwnName(found["where"], found["law"], found["settings"][1:]) if found else None


def own_title(name: OwnName) -> str:
    """Return what tables call it."""
    return f"{name.law},{name.settings}" if name.settings else name.law


def own_file(name: OwnName) -> Path:
    """Return the file that a law is written in.

    Raises:
        ConfigError: if there is none.
    """
    if name.where.endswith(".py"):
        file = Path(name.where)
        if not file.is_file():
            if file.exists():
                raise ConfigError(f"{file}: is no file")
            others = [each.name for each in file.parent.glob("*.py")] if file.parent.is_dir() else []
            raise ConfigError(f"{file}: no such file{did_you_mean(file.name, others)}")
        return file
    return Path(_module(name).__file__ or name.where)


def make_own(text: str, prior: Params) -> OwnPolicy:
    """Return the policy of a law of your own.

    Args:
        text: its name.
        prior: what it believes of the robot.

    Raises:
        ConfigError: if file, module or class are not there or not right, or the law fails; with file and line.
        UnfitError: if the law cannot control the robot.
    """
    name = own_name(text)
    assert name is not None, text
    file = own_file(name)
    kind, settings = _class(name, _module(name), file), _settings(name, text)
    try:
        inspect.signature(kind).bind(**settings)
    except TypeError as error:
        known = ", ".join(inspect.signature(kind).parameters) or "none"
        raise ConfigError(f"{text}: settings of {name.law}: {error}; it has {known}") from None
    try:
        law = kind(**settings)
    except UnfitError as error:
        raise UnfitError(f"{own_title(name)}: {error}") from None
    except FAULTS as error:
        raise ConfigError(_explain(file, f"{name.law}.__init__", error)) from error
    return OwnPolicy(own_title(name), law, file, prior)


def _settings(name: OwnName, text: str) -> dict[str, Any]:
    """Return the settings of a law."""
    settings: dict[str, Any] = {}
    for part in _SETTING.split(name.settings) if name.settings else ():
        key, equals, value = part.partition("=")
        if not equals or not key.strip().isidentifier():
            raise ConfigError(f"{text}: {part.strip()!r} is no setting; write key=value, separated by commas")
        if key.strip() in settings:
            raise ConfigError(f"{text}: {key.strip()} is given twice")
        try:
            settings[key.strip()], _ = parse_yaml(value)
        except UNREADABLE:
            raise ConfigError(f"{text}: {key.strip()} = {value.strip()!r}: no YAML value") from None
    return settings


def _class(name: OwnName, module: ModuleType, file: Path) -> type[ControlLaw]:
    """Return the class of a law; raises ConfigError."""
    laws = [
        key for key, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, ControlLaw) and value is not ControlLaw
    ]  # fmt: skip
    kind = getattr(module, name.law, None)
    if kind is None:
        raise ConfigError(
            f"{file}: has no {name.law}{did_you_mean(name.law, laws)} (laws in it: {', '.join(laws) or 'none'})"
        )
    if not (isinstance(kind, type) and issubclass(kind, ControlLaw)):
        raise ConfigError(f"{file}: {name.law} is no law: derive it from sffr_baselines.ControlLaw")
    return kind


def _module(name: OwnName) -> ModuleType:
    """Return the module of a law, run if it was not yet; raises ConfigError."""
    if not name.where.endswith(".py"):
        here = str(Path.cwd())
        sys.path.insert(0, here)
        try:
            return importlib.import_module(name.where)
        except ModuleNotFoundError as error:
            raise ConfigError(f"{name.where}: no such module: {error}") from None
        except FAULTS as error:
            raise ConfigError(_explain(Path(name.where), "import", error)) from error
        finally:
            sys.path.remove(here)
    file = Path(name.where).absolute()
    known = f"sffr_own_{short_hash(str(file))}_{short_hash(file.read_bytes().hex())}"
    if known in sys.modules:
        return sys.modules[known]
    spec = importlib.util.spec_from_file_location(known, file)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{file}: cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[known] = module
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(module)
    except FAULTS as error:
        del sys.modules[known]
        raise ConfigError(_explain(Path(name.where), "import", error)) from error
    finally:
        sys.path.remove(str(file.parent))
    return module


def _explain(file: Path, what: str, error: BaseException) -> str:
    """Return an error with the last line of a file that led to it."""
    if isinstance(error, SyntaxError):
        return f"{error.filename or file}{f':{error.lineno}' if error.lineno else ''}: {error.msg}"
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename) == file.absolute()]
    where = f"{file}:{own[-1].lineno}" if own else str(file)
    return f"{where}: {what}: {describe_error(error)}"
