"""All kinds of hostile inputs by their names; each is imported where it is used, since some need torch."""

from __future__ import annotations

import importlib

from trial import Kind

KINDS = {  # name: module and class
    "configs": ("configs", "Configs"),
    "policies": ("policies", "Policies"),
    "checkpoints": ("checkpoints", "Checkpoints"),
    "folders": ("folders", "Folders"),
    "states": ("states", "States"),
    "arguments": ("arguments", "Arguments"),
    "machines": ("machines", "Machines"),
    "periods": ("periods", "Periods"),
    "kills": ("kills", "Kills"),
}
FAKES = "fakes"  # violates everything, to see that the harness notices


def make_kind(name: str) -> Kind:
    """Return the kind of a name."""
    module, kind = ("fakes", "Fakes") if name == FAKES else KINDS[name]
    made: Kind = getattr(importlib.import_module(module), kind)()
    return made
