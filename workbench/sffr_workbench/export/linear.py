"""Linear models as files: ``.mat`` for MATLAB, Octave and SciPy, ``.npz`` for NumPy; docs/control.md has the schema."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from sffr_gym import ConfigError
from sffr_gym.physics.linearization import LinearModel

LINEAR_SUFFIXES = (".mat", ".npz")
_KINDS = ("states", "inputs", "outputs")


def linear_arrays(model: LinearModel) -> dict[str, Any]:
    """Return the entries of a file: the continuous model, the one sampled at the control period, names and units.

    Args:
        model: continuous.
    """
    sampled = model.discrete()
    arrays: dict[str, Any] = {name: getattr(model, name) for name in ("A", "B", "C", "D", "drift", "x0", "u0", "y0")}
    arrays |= {"Ad": sampled.A, "Bd": sampled.B, "driftd": sampled.drift, "Ts": model.control_period}
    for kind in _KINDS:
        labels = getattr(model, kind)
        arrays[f"{kind}_names"] = np.array([label.name for label in labels])
        arrays[f"{kind}_units"] = np.array([label.unit for label in labels])
    return arrays | {"derivative_error": model.error}


def linear_bytes(model: LinearModel, suffix: str) -> bytes:
    """Return the content of a file of a model.

    Args:
        model: continuous.
        suffix: one of ``LINEAR_SUFFIXES``.

    Raises:
        ConfigError: for another one.
    """
    arrays, file = linear_arrays(model), io.BytesIO()
    suffix = suffix.lower()
    if suffix == ".mat":
        cells = {name: array.astype(object) for name, array in arrays.items() if np.asarray(array).dtype.kind == "U"}
        savemat(file, arrays | cells, do_compression=True, oned_as="column")
    elif suffix == ".npz":
        np.savez_compressed(file, allow_pickle=False, **arrays)
    else:
        raise ConfigError(f"{suffix or 'no ending'}: a linear model is written as {' or '.join(LINEAR_SUFFIXES)}")
    return file.getvalue()


def check_suffix(file: Path) -> None:
    """Make sure that a file's ending is one of a linear model; raises ConfigError."""
    if file.suffix.lower() not in LINEAR_SUFFIXES:
        raise ConfigError(f"{file}: a linear model is written as {' or '.join(LINEAR_SUFFIXES)}")
