"""What rounding can do to a program: the size of its terms, and a bound on its error over a whole run.

Both are first order in the rounding (Higham, "Accuracy and stability of numerical algorithms", 2002, section 3.3, the
running error), and take it that no comparison falls the other way.
"""

import numpy as np

from .operations import FLOATS, LIBRARY, OPERATIONS
from .program import Atom, FixedNumber, Operation, Program, Variable

Array = np.ndarray
_EXACT_WORDS = """
neg abs max min select sign floor ceil round_even round_away is_finite bits to_integer eq ne lt le gt ge and or not xor
"""
_EXACT = frozenset(_EXACT_WORDS.split())
_FLAT = _EXACT - {"neg", "abs", "max", "min", "select", "bits"}
_LIBM_ULP = 1.0  # units in the last place that a function of <math.h> may be off, as glibc and newlib promise


class Trace:
    """Every value of a program along a run.

    Attributes:
        program: the program.
        values: by variable, one number a sample in the variable's own kind.
    """

    def __init__(self, program: Program, inputs: Array) -> None:
        """Evaluate.

        Args:
            program: the program.
            inputs: its inputs, shape (samples, inputs).
        """
        self.program = program
        self.values: dict[int, Array] = {
            variable.index: inputs[:, place].astype(variable.kind) for place, variable in enumerate(program.inputs)
        }
        with np.errstate(all="ignore"):
            for operation in program.operations:
                self.values[operation.result.index] = _evaluate(operation, [self(a) for a in operation.arguments])

    def __call__(self, atom: Atom) -> Array:
        """The values of an atom; a constant's is one number."""
        return np.asarray(atom.value) if isinstance(atom, FixedNumber) else self.values[atom.index]

    def outputs(self) -> Array:
        """Shape (samples, outputs), as float64."""
        samples = len(next(iter(self.values.values())))
        return np.stack([np.broadcast_to(self(a), samples).astype(float) for a in self.program.outputs], axis=1)

    def term_sizes(self) -> Array:
        """The size of the largest term that each output is summed from, shape (samples, outputs).

        A difference of two nearly equal numbers cannot be better than the rounding of those: it is this size whose
        last place counts.
        """
        sizes = {variable.index: np.abs(self._real(variable)) for variable in self.program.inputs}

        def of(atom: Atom) -> Array:
            return np.abs(np.asarray(atom.value, float)) if isinstance(atom, FixedNumber) else sizes[atom.index]

        with np.errstate(all="ignore"):
            for operation in self.program.operations:
                size = np.abs(self._real(operation.result)) if operation.result.kind in FLOATS else np.zeros(())
                for atom, slope in self._joined_slopes(operation):
                    size = np.fmax(size, np.where(slope == 0.0, 0.0, np.abs(slope) * of(atom)))
                sizes[operation.result.index] = size
        return self._table([of(atom) for atom in self.program.outputs])

    def _joined_slopes(self, operation: Operation) -> list[tuple[Atom, Array]]:
        """One slope for each different argument: a + a is one term twice as large."""
        joined: dict[Atom, Array] = {}
        for atom, slope in zip(operation.arguments, self._slopes(operation), strict=True):
            if slope is not None:
                joined[atom] = joined[atom] + slope if atom in joined else slope
        return list(joined.items())

    def sensitivities(self, unit: float) -> tuple[Array, Array]:
        """What rounding and the inputs do to the outputs, by one pass backwards for each output.

        Args:
            unit: rounding of one operation, relative [1].

        Returns:
            (a bound on what the step's own rounding moves each output, shape (samples, outputs); d output / d input,
            shape (samples, outputs, inputs)).
        """
        own, slopes = [], []
        with np.errstate(all="ignore"):
            known = {operation.result.index: self._slopes(operation) for operation in self.program.operations}
            for output in self.program.outputs:
                local, back = self._backwards(output, known, unit)
                own.append(local)
                slopes.append(self._table([back.get(v.index, np.zeros(())) for v in self.program.inputs]))
        return self._table(own), np.stack(slopes, axis=1)

    def _backwards(self, output: Atom, known: dict[int, list[Array | None]], unit: float) -> tuple[Array, dict]:
        back: dict[int, Array] = {} if isinstance(output, FixedNumber) else {output.index: np.ones(())}
        local = np.zeros(())
        for operation in reversed(self.program.operations):
            adjoint = back.pop(operation.result.index, None)
            if adjoint is None:
                continue
            if operation.result.kind in FLOATS and operation.name not in _EXACT:
                rounding = 2.0 * _LIBM_ULP * unit if operation.name in LIBRARY else unit
                size = np.abs(adjoint) * np.abs(self._real(operation.result))
                local = local + rounding * np.where(adjoint == 0.0, 0.0, size)
            for atom, slope in zip(operation.arguments, known[operation.result.index], strict=True):
                if slope is not None and not isinstance(atom, FixedNumber):
                    # A branch that is not taken may be anything.
                    part = np.where((slope == 0.0) | (adjoint == 0.0), 0.0, slope * adjoint)
                    back[atom.index] = back[atom.index] + part if atom.index in back else part
        return local, back

    def _real(self, variable: Variable) -> Array:
        return self.values[variable.index].astype(float)

    def _table(self, columns: list[Array]) -> Array:
        samples = len(self.values[self.program.inputs[0].index])
        return np.stack([np.broadcast_to(column, samples).astype(float) for column in columns], axis=1)

    def _slopes(self, operation: Operation) -> list[Array | None]:
        """d result / d argument; of whole numbers that are the bits of a float, of their relative size; None: flat."""
        name, kinds = operation.name, [atom.kind for atom in operation.arguments]
        arguments = [self(atom) for atom in operation.arguments]
        result = self.values[operation.result.index]
        if name == "bits":
            return [1.0 / arguments[0].astype(float) if kinds[0] in FLOATS else result.astype(float)]
        if operation.result.kind not in FLOATS:
            return [np.ones(()), None] if name in ("add", "sub") else [None] * len(kinds)
        if name in _FLAT or (name == "convert" and kinds[0] not in FLOATS):
            return [None] * len(kinds)
        slopes: list[Array | None] = list(
            _slopes(name, [each.astype(float) for each in arguments], result.astype(float))
        )
        return slopes


def run_bound(trace: Trace, inputs: int, units: tuple[float, float], rounded_inputs: bool) -> Array:
    """A bound on how far two runs of a law may be apart that round each step on their own, shape (samples, outputs).

    Args:
        trace: along the run; the program's outputs end with the next state.
        inputs: how many inputs stand before the state.
        units: rounding of one operation in each of the two [1].
        rounded_inputs: whether the first of them sees its inputs rounded.
    """
    program = trace.program
    state = program.inputs[inputs:]
    shown = len(program.outputs) - len(state)
    own, slopes = trace.sensitivities(sum(units))
    if rounded_inputs:
        read = np.stack([np.abs(trace.values[v.index].astype(float)) for v in program.inputs[:inputs]], axis=1)
        own = own + units[0] * np.einsum("kij,kj->ki", np.abs(slopes[:, :, :inputs]), read)
    if not state:
        return own
    gains = slopes[:, :, inputs:]
    return _worst_case(gains[:, shown:], gains[:, :shown], own[:, shown:], own[:, :shown])


def _worst_case(moves: Array, reads: Array, kicks: Array, own: Array) -> Array:
    """The largest |y_k| of e_k+1 = A_k e_k + b_k, y_k = C_k e_k + d_k for all |b| <= kicks and |d| <= own.

    The sum of |C_k A_k-1 ... A_j+1| kicks_j over all j < k, signs kept within the products: their sizes alone would
    grow without end where an observer's estimates trade with each other. Exact at every checkpoint; between two the
    errors at the last one are taken as independent.

    Args:
        moves: A, shape (samples, states, states).
        reads: C, shape (samples, outputs, states).
        kicks: shape (samples, states).
        own: shape (samples, outputs).
    """
    samples, states = kicks.shape
    every = max(16, int(1.3 * np.sqrt(samples)))
    starts = np.arange(0, samples, every)
    boxes = np.zeros((len(starts), states))
    ways = np.zeros((len(starts), states, states))
    for step in range(starts[-1] - 1, -1, -1):
        first = step // every + 1  # the checkpoints behind this step
        if step + 1 == starts[first]:
            ways[first] = np.eye(states)
        boxes[first:] += np.abs(ways[first:]) @ kicks[step]
        ways[first:] = ways[first:] @ moves[step]
    bound = np.empty_like(own)
    parts = boxes[:, :, None] * np.eye(states)  # what moves the error, one column each
    for step in range(every):
        rows = starts[starts + step < samples] + step
        parts = parts[: len(rows)]
        bound[rows] = own[rows] + np.abs(reads[rows] @ parts).sum(axis=2)
        parts = np.concatenate([moves[rows] @ parts, kicks[rows][:, :, None] * np.eye(states)], axis=2)
    return bound


def _evaluate(operation: Operation, arguments: list[Array]) -> Array:
    kind = operation.result.kind
    if operation.name == "bits":
        return np.ascontiguousarray(arguments[0]).view(kind).reshape(np.shape(arguments[0]))
    return np.asarray(OPERATIONS[operation.name].value(*arguments)).astype(kind)


def _slopes(name: str, arguments: list[Array], result: Array) -> list[Array]:
    """d result / d argument for each argument."""
    one = np.ones(())
    a = arguments[0]
    b = arguments[1] if len(arguments) > 1 else one
    if name in ("add", "sub"):
        return [one, one if name == "add" else -one]
    if name in ("neg", "convert"):
        return [-one if name == "neg" else one]
    if name == "abs":
        return [np.where(a < 0.0, -1.0, 1.0)]
    if name == "mul":
        return [b, a]
    if name == "div":
        return [1.0 / b, -result / b]
    if name in ("max", "min"):
        first = (a >= b) if name == "max" else (a <= b)
        return [first * 1.0, ~first * 1.0]
    if name == "select":
        chosen = a != 0.0
        return [np.zeros(()), chosen * 1.0, ~chosen * 1.0]
    if name == "sqrt":
        return [0.5 / result]
    if name == "exp":
        return [result]
    if name == "log":
        return [1.0 / a]
    if name == "pow":
        return [b * result / a, result * np.log(np.abs(a))]
    if name == "rem":
        return [one, -np.trunc(a / b)]
    # A function of the library: its slope by a central difference, accurate enough for a bound.
    found = []
    for place, argument in enumerate(arguments):
        step = 1e-6 * np.maximum(np.abs(argument), 1e-3)
        ends = []
        for side in (step, -step):
            moved = [each + side if i == place else each for i, each in enumerate(arguments)]
            ends.append(OPERATIONS[name].value(*moved))
        found.append((ends[0] - ends[1]) / (2.0 * step))
    return found
