"""Kernels: functions of plain arrays and scalars, compiled when the package is built.

A kernel is written, read and tested as Python. Those that Python calls often are *entries*: they have a place in the
library of compiled code (see :mod:`sffr_gym.compile.library`), where the kernels that they call are compiled with
them. Kernels never raise and own no memory (see :mod:`sffr_gym.compile.workspace`): they neither make arrays nor return
any. Called by themselves they run as the Python functions that they are.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from sffr_gym.compile.arguments import Block
from sffr_gym.compile.library import load_library

Exemplars = Callable[[], Iterator[tuple[str, tuple[Any, ...]]]]

KERNELS: dict[Callable[..., Any], bool] = {}  # of all modules that were imported; whether each is pasted into callers
ENTRIES: dict[str, Entry] = {}  # by name


def kernel(function: Callable[..., Any] | None = None, *, inline: bool = True) -> Any:
    """Register a function to be compiled with the entries that call it; returns it as it is.

    Args:
        function: the function, when used as a plain decorator.
        inline: paste it into its callers; if not, it is compiled once for all of them.
    """
    if function is None:
        return functools.partial(kernel, inline=inline)
    KERNELS[function] = inline
    return function


def entry(function: Callable[..., Any]) -> Entry:
    """Make a kernel an :class:`Entry`, whose arguments a function that it decorates shows."""
    KERNELS[function] = True
    made = Entry(function)
    ENTRIES[made.name] = made
    return made


class Entry:
    """A kernel that Python calls.

    Its results are what it leaves in the arrays that it is given.

    Attributes:
        name: of the function, with its module's.
        function: as it is written.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self.function, self.name = function, f"{function.__module__}.{function.__name__}"
        self.exemplars: Exemplars = lambda: iter(())

    def shown_by(self, exemplars: Exemplars) -> Exemplars:
        """Decorate a function that yields a label and arguments for each form in which the entry is compiled.

        What has the same label is compiled together, and shares the kernels that are not pasted into their callers.
        """
        self.exemplars = exemplars
        return exemplars

    def bind(self, *arguments: Any) -> Call:
        """Return a call with these arguments, prepared once for as often as it is made.

        Arguments are named tuples of arrays and numbers, nested at will, and arrays and numbers themselves. Arrays are
        taken as they are, numbers as they are now.

        Raises:
            TypeError: for arguments of a form in which the entry is not compiled.
        """
        return Call(self, arguments)

    def __call__(self, *arguments: Any) -> None:
        """Call the kernel once."""
        self.bind(*arguments)()

    def __reduce__(self) -> str:
        """Copy it as what it is called in its module: there is one of each."""
        return self.function.__name__


class Call:
    """An entry with its arguments, see :meth:`Entry.bind`; a copy of it is one with copies of these."""

    __slots__ = ("_address", "_block", "_compiled", "arguments", "entry")

    def __init__(self, entry: Entry, arguments: tuple[Any, ...]) -> None:
        self.entry, self.arguments = entry, arguments
        library = load_library()
        if library is None:
            self._compiled = None
            return
        self._block = Block(arguments)
        self._compiled = library.function(entry.name, self._block.form)
        self._address = self._block.address

    def __call__(self) -> None:
        """Run the kernel; other threads may run meanwhile if it is compiled.

        Raises:
            IndexError: for an index that is out of range, as Python, or if bounds were compiled in.
        """
        if self._compiled is None:
            self.entry.function(*self.arguments)
        elif self._compiled(self._address):
            raise IndexError(f"{self.entry.name}: an index is out of range")

    def __reduce__(self) -> Any:
        """Copy what is called, not where it lies."""
        return Call, (self.entry, self.arguments)
