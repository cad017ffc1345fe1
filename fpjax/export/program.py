"""A straight-line program of scalars: a list of operations, each of which uses inputs and earlier results only."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class FixedNumber:
    """A number that is known when the code is written.

    Attributes:
        value: a numpy scalar; its dtype is the constant's kind.
        name: the parameter's name; "" for a number that was computed, or that belongs to a formula.
    """

    value: np.generic
    name: str = ""

    @property
    def kind(self) -> str:
        """The dtype's name."""
        return self.value.dtype.name

    def key(self) -> tuple[str, str, str]:
        """A key that is equal for constants with the same bits and name (0.0 and -0.0 differ, a NaN equals itself)."""
        return (self.kind, self.value.tobytes().hex(), self.name)


@dataclasses.dataclass(frozen=True)
class Variable:
    """The result of an operation, or an input.

    Attributes:
        index: place in the program.
        kind: name of its dtype.
    """

    index: int
    kind: str


Atom = FixedNumber | Variable


@dataclasses.dataclass(frozen=True)
class Operation:
    """One operation.

    Attributes:
        name: its name in `operations.OPERATIONS`.
        arguments: its operands.
        result: the variable of its result.
    """

    name: str
    arguments: tuple[Atom, ...]
    result: Variable


@dataclasses.dataclass(frozen=True)
class Program:
    """The result of `flatten`: a function with every array split into scalars and every call inlined.

    Attributes:
        inputs: one variable for each input scalar.
        operations: in an order in which they can run; every one is needed for an output.
        outputs: one atom for each output scalar.
    """

    inputs: tuple[Variable, ...]
    operations: tuple[Operation, ...]
    outputs: tuple[Atom, ...]

    def uses(self) -> dict[int, int]:
        """How often each variable is read, the outputs counted."""
        counts: dict[int, int] = {}
        for atom in (*(atom for operation in self.operations for atom in operation.arguments), *self.outputs):
            if isinstance(atom, Variable):
                counts[atom.index] = counts.get(atom.index, 0) + 1
        return counts

    def counts(self) -> dict[tuple[str, str], int]:
        """How many operations there are, by name and by the kind of their first argument."""
        found: dict[tuple[str, str], int] = {}
        for operation in self.operations:
            key = (operation.name, operation.arguments[0].kind)
            found[key] = found.get(key, 0) + 1
        return found


class Builder:
    """Collects operations; the same operation on the same arguments is stored once (common subexpressions)."""

    def __init__(self, most: int, too_many: Callable[[], Exception]) -> None:
        """Start empty.

        Args:
            most: largest number of operations.
            too_many: makes the exception that is raised beyond it.
        """
        self.operations: list[Operation] = []
        self.known: dict[int, np.generic] = {}  # variables that depend on parameters alone
        self.count = 0
        # a matrix product or a loop unrolls into scalars: the limit stops it while the code can still be read and
        # compiled
        self._most, self._too_many = most, too_many
        self._made: dict[tuple[object, ...], Variable] = {}

    def variable(self, kind: str) -> Variable:
        """A new variable."""
        self.count += 1
        return Variable(self.count - 1, kind)

    def emit(self, name: str, arguments: Sequence[Atom], kind: str) -> Variable:
        """The variable of an operation's result: of a new operation, or of an equal one that is already there."""
        key = (name, kind, *(atom.key() if isinstance(atom, FixedNumber) else atom.index for atom in arguments))
        if key not in self._made:
            if len(self.operations) >= self._most:
                raise self._too_many()
            result = self.variable(kind)
            self.operations.append(Operation(name, tuple(arguments), result))
            self._made[key] = result
        return self._made[key]

    def value(self, atom: Atom) -> np.generic | None:
        """The value of an atom that depends on constants and parameters alone; None for any other."""
        return atom.value if isinstance(atom, FixedNumber) else self.known.get(atom.index)

    def program(self, inputs: Sequence[Variable], outputs: Sequence[Atom]) -> Program:
        """The program of the operations that the outputs need, in order."""
        needed = {atom.index for atom in outputs if isinstance(atom, Variable)}
        kept: list[Operation] = []
        for operation in reversed(self.operations):
            if operation.result.index in needed:
                kept.append(operation)
                needed |= {atom.index for atom in operation.arguments if isinstance(atom, Variable)}
        return Program(tuple(inputs), tuple(reversed(kept)), tuple(outputs))
