"""Compiled loops that exist to be timed; imported by what measures alone, since nothing else needs them compiled."""

from pathlib import Path

from sffr_gym.compile.cache import cache_sources

cache_sources(__name__, Path(__file__).parent.rglob("*.py"))
