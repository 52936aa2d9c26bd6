"""Compiled loops that exist to be timed."""
