"""Registers of a simulated UR controller: outputs of a program, and inputs from clients.

An input belongs to one client at a time, and is free again when that client leaves. This is kept on purpose.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from mocks.shared.clock import Past

COUNT = 48

Variable = tuple[str, Callable[[], Any]]
"""A variable of RTDE: the name of its type, and a function that reads it."""


class Registers:
    """Integer and double outputs, and integer inputs. `served`: software 3.9 and later has them."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.served = True
        self.inputs: dict[int, int] = {}
        self.input_changed = asyncio.Event()
        self._integers: Past[dict[int, int]] = Past(now, {})
        self._doubles: Past[dict[int, float]] = Past(now, {})
        self._owners: dict[str, object] = {}
        self.received: dict[str, float] = {}  # input: when, on the clock of the wall

    @property
    def integers(self) -> dict[int, int]:
        return self._integers.value

    @property
    def doubles(self) -> dict[int, float]:
        return self._doubles.value

    def write_integer(self, register: int, value: int) -> None:
        """Write an integer output, as a program's `write_output_integer_register`."""
        self._integers.change(self.integers | {register: value})

    def write_double(self, register: int, value: float) -> None:
        """Write a float output, as a program's `write_output_float_register`."""
        self._doubles.change(self.doubles | {register: value})

    def variables(self) -> dict[str, Variable]:
        """Return the outputs by name; empty if the software has no registers."""
        if not self.served:
            return {}
        integers = {
            f"output_int_register_{i}": ("INT32", lambda i=i: self.integers.get(i, 0)) for i in range(COUNT)
        }
        return integers | {
            f"output_double_register_{i}": ("DOUBLE", lambda i=i: self.doubles.get(i, 0.0))
            for i in range(COUNT)
        }

    def kind_of_input(self, name: str, client: object) -> str:
        """Return the type of an input, or the refusal to `client` (`NOT_FOUND`, `IN_USE`)."""
        if not self.served or name not in _INPUTS:
            return "NOT_FOUND"
        return "INT32" if self._owners.get(name, client) is client else "IN_USE"

    def claim(self, names: Iterable[str], client: object) -> None:
        """Give the inputs to the client until it releases them."""
        self._owners |= dict.fromkeys(names, client)

    def release(self, client: object) -> None:
        """Free the inputs of a client that has left."""
        self._owners = {name: owner for name, owner in self._owners.items() if owner is not client}

    def receive(self, names: Sequence[str], values: Sequence[int]) -> None:
        """Take the values of inputs that a client has sent."""
        for name, value in zip(names, values, strict=True):
            self.received[name] = time.monotonic()
            self.inputs[_INPUTS[name]] = value
        self.input_changed.set()


_INPUTS = {f"input_int_register_{i}": i for i in range(COUNT)}
