"""The effect of rounding on a program: the size of its terms, and a bound on its error over a whole run.

Both are first order in the rounding (Higham, "Accuracy and stability of numerical algorithms", 2002, section 3.3,
running error analysis), and assume that rounding changes the outcome of no comparison.
"""

from collections.abc import Sequence

import numpy as np

from ..logs.arrays import Numbers, Values
from .operations import FLOATS, LIBRARY, OPERATIONS
from .program import Atom, FixedNumber, Operation, Program, Variable

# Operations without a rounding error of their own.
_EXACT_WORDS = """
neg abs max min select sign floor ceil round_even round_away is_finite bits to_integer eq ne lt le gt ge and or not xor
"""
_EXACT = frozenset(_EXACT_WORDS.split())
_FLAT = _EXACT - {"neg", "abs", "max", "min", "select", "bits"}  # those of slope zero almost everywhere
_LIBM_ULP = 1.0  # largest error of a function of <math.h> [units in the last place], as documented for glibc and newlib


class Trace:
    """Every value of a program along a run.

    Attributes:
        program: the program.
        values: by variable, one number a sample in the variable's own kind.
    """

    def __init__(self, program: Program, inputs: Values) -> None:
        """Evaluate.

        Args:
            program: the program.
            inputs: its inputs, shape (samples, inputs).
        """
        self.program = program
        self.values: dict[int, Values] = {
            variable.index: inputs[:, place].astype(variable.kind) for place, variable in enumerate(program.inputs)
        }
        with np.errstate(all="ignore"):
            for operation in program.operations:
                self.values[operation.result.index] = _evaluate(operation, [self(a) for a in operation.arguments])

    def __call__(self, atom: Atom) -> Values:
        """The values of an atom along the run, shape (samples,); a single number for a constant."""
        return np.asarray(atom.value) if isinstance(atom, FixedNumber) else self.values[atom.index]

    def outputs(self) -> Values:
        """Shape (samples, outputs), as float64."""
        samples = len(next(iter(self.values.values())))
        return np.stack([np.broadcast_to(self(a), samples).astype(float) for a in self.program.outputs], axis=1)

    def term_sizes(self) -> Values:
        """The magnitude of the largest term in the sum behind each output, shape (samples, outputs).

        A difference of two nearly equal numbers cannot be more accurate than these are rounded, so an output's error is
        measured in units of the last place of this magnitude.
        """
        sizes = {variable.index: np.abs(self._real(variable)) for variable in self.program.inputs}

        def of(atom: Atom) -> Numbers:
            return np.abs(np.asarray(atom.value, float)) if isinstance(atom, FixedNumber) else sizes[atom.index]

        with np.errstate(all="ignore"):
            for operation in self.program.operations:
                size = np.abs(self._real(operation.result)) if operation.result.kind in FLOATS else np.zeros(())
                for atom, slope in self._joined_slopes(operation):
                    size = np.fmax(size, np.where(slope == 0.0, 0.0, np.abs(slope) * of(atom)))
                sizes[operation.result.index] = size
        return self._table([of(atom) for atom in self.program.outputs])

    def _joined_slopes(self, operation: Operation) -> list[tuple[Atom, Numbers]]:
        """The slope by each different argument: in a + a the one argument has the slope 2."""
        joined: dict[Atom, Numbers] = {}
        for atom, slope in zip(operation.arguments, self._slopes(operation), strict=True):
            if slope is not None:
                joined[atom] = joined[atom] + slope if atom in joined else slope
        return list(joined.items())

    def sensitivities(self, unit: float) -> tuple[Values, Values]:
        """The effect of rounding and of the inputs on the outputs, by one backward pass for each output.

        Args:
            unit: relative rounding error of one operation [1].

        Returns:
            (a bound on the error of each output from the roundings of this step, shape (samples, outputs); d output /
            d input, shape (samples, outputs, inputs)).
        """
        own, slopes = [], []
        with np.errstate(all="ignore"):
            known = {operation.result.index: self._slopes(operation) for operation in self.program.operations}
            for output in self.program.outputs:
                local, back = self._backwards(output, known, unit)
                own.append(local)
                slopes.append(self._table([back.get(v.index, np.zeros(())) for v in self.program.inputs]))
        return self._table(own), np.stack(slopes, axis=1)

    def _backwards(
        self, output: Atom, known: dict[int, list[Numbers | None]], unit: float
    ) -> tuple[Numbers, dict[int, Numbers]]:
        """Reverse-mode differentiation of one output.

        Args:
            output: the output.
            known: the slopes of every operation, by the variable of its result.
            unit: relative rounding error of one operation [1].

        Returns:
            (the sum of |d output / d result| x rounding of the result over all operations, shape (samples,); the
            derivatives by the inputs, by variable).
        """
        back: dict[int, Numbers] = {} if isinstance(output, FixedNumber) else {output.index: np.ones(())}
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
                    # A branch that is not selected may hold infinity or NaN: its zero slope must stay zero.
                    part = np.where((slope == 0.0) | (adjoint == 0.0), 0.0, slope * adjoint)
                    back[atom.index] = back[atom.index] + part if atom.index in back else part
        return local, back

    def _real(self, variable: Variable) -> Values:
        return self.values[variable.index].astype(float)

    def _table(self, columns: Sequence[Numbers]) -> Values:
        samples = len(self.values[self.program.inputs[0].index])
        return np.stack([np.broadcast_to(column, samples).astype(float) for column in columns], axis=1)

    def _slopes(self, operation: Operation) -> list[Numbers | None]:
        """d result / d argument; None where the result is constant in the argument.

        Integers occur as the bits of a float, in the exponent arithmetic of the logarithm. Their slope is that of
        the float's relative change, so that a float passes through its bits and back with slope one.
        """
        name, kinds = operation.name, [atom.kind for atom in operation.arguments]
        arguments = [self(atom) for atom in operation.arguments]
        result = self.values[operation.result.index]
        if name == "bits":
            return [1.0 / arguments[0].astype(float) if kinds[0] in FLOATS else result.astype(float)]
        if operation.result.kind not in FLOATS:
            return [np.ones(()), None] if name in ("add", "sub") else [None] * len(kinds)
        if name in _FLAT or (name == "convert" and kinds[0] not in FLOATS):
            return [None] * len(kinds)
        slopes: list[Numbers | None] = list(
            _slopes(name, [each.astype(float) for each in arguments], result.astype(float))
        )
        return slopes


def run_bound(trace: Trace, inputs: int, units: tuple[float, float], rounded_inputs: bool) -> Values:
    """A bound on the difference of two runs of a law, each with its own rounding, shape (samples, outputs).

    Args:
        trace: along the run; the program's outputs end with the next state.
        inputs: number of inputs before the state.
        units: relative rounding error of one operation in each of the two runs [1].
        rounded_inputs: whether the first of the two gets its inputs rounded.
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


def _worst_case(moves: Values, reads: Values, kicks: Values, own: Values) -> Values:
    """The largest |y_k| of e_k+1 = A_k e_k + b_k, y_k = C_k e_k + d_k for all |b| <= kicks and |d| <= own.

    It is the sum of |C_k A_k-1 ... A_j+1| kicks_j over all j < k, the magnitude taken of the whole product. A product
    of magnitudes would grow without limit where two estimates of an observer trade off.

    The exact sum takes samples^2 products. Here it is exact at checkpoints, about 1.3 sqrt(samples) apart. Between two
    checkpoints the errors of the states at the last one are taken as independent, which can only enlarge the bound.

    Args:
        moves: A, shape (samples, states, states).
        reads: C, shape (samples, outputs, states).
        kicks: bound on |b|, shape (samples, states).
        own: bound on |d|, shape (samples, outputs).

    Returns:
        The bound on |y|, shape (samples, outputs).
    """
    samples, states = kicks.shape
    every = max(16, int(1.3 * np.sqrt(samples)))
    starts = np.arange(0, samples, every)
    # First pass, backwards in time: `ways` is the product A ... A from the current step to each later checkpoint,
    # `boxes` the sum of its magnitude times the kicks, the bound on the state's error at that checkpoint.
    boxes = np.zeros((len(starts), states))
    ways = np.zeros((len(starts), states, states))
    for step in range(starts[-1] - 1, -1, -1):
        first = step // every + 1  # the checkpoints behind this step
        if step + 1 == starts[first]:
            ways[first] = np.eye(states)
        boxes[first:] += np.abs(ways[first:]) @ kicks[step]
        ways[first:] = ways[first:] @ moves[step]
    # Second pass, forwards within all intervals side by side: every source of error is a column that the states' matrix
    # moves on; each step adds its own kicks as new columns. Shape (checkpoints, states, columns).
    bound = np.empty_like(own)
    parts = boxes[:, :, None] * np.eye(states)
    for step in range(every):
        rows = starts[starts + step < samples] + step
        parts = parts[: len(rows)]
        bound[rows] = own[rows] + np.abs(reads[rows] @ parts).sum(axis=2)
        parts = np.concatenate([moves[rows] @ parts, kicks[rows][:, :, None] * np.eye(states)], axis=2)
    return bound


def _evaluate(operation: Operation, arguments: list[Values]) -> Values:
    kind = operation.result.kind
    if operation.name == "bits":
        return np.ascontiguousarray(arguments[0]).view(kind).reshape(np.shape(arguments[0]))
    return np.asarray(OPERATIONS[operation.name].value(*arguments)).astype(kind)


def _slopes(name: str, arguments: list[Values], result: Values) -> list[Numbers]:
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
    # For a function of the library a central difference is accurate enough for a bound.
    found = []
    for place, argument in enumerate(arguments):
        step = 1e-6 * np.maximum(np.abs(argument), 1e-3)
        ends = []
        for side in (step, -step):
            moved = [each + side if i == place else each for i, each in enumerate(arguments)]
            ends.append(OPERATIONS[name].value(*moved))
        found.append((ends[0] - ends[1]) / (2.0 * step))
    return found
