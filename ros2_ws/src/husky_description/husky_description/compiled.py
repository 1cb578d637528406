"""Calls of kernels without numba's look at the types of their arguments each time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import typeof


class Compiled:
    """A kernel, compiled for the types of its first call.

    A look at a named tuple of five arrays takes 2 us, more than many a kernel. It is for kernels of
    a tick, whose arguments are the caller's own.

    Attributes:
        call: calls the kernel. Later arrays must have the dimensions of the first ones and their
            order in memory: what is no array of such numbers is refused, more is not looked at.
    """

    def __init__(self, kernel: Any) -> None:
        """Compile at the first call; the kernel is numba's."""
        self._kernel = kernel
        self.call: Callable[..., Any] = self._first_call

    def _first_call(self, *arguments: Any) -> Any:
        types = tuple(typeof(argument) for argument in arguments)
        self.call = self._kernel.compile(types)
        return self.call(*arguments)
