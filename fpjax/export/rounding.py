"""The effect of rounding on a program: the size of its terms, and a bound on its error over a whole run.

Both are first order in the rounding (Higham, "Accuracy and stability of numerical algorithms", 2002, section 3.3,
running error analysis), and assume that rounding changes the outcome of no comparison.
"""

from collections.abc import Sequence

import numpy as np

from ..compiled.threads import one_blas_thread
from ..logs.arrays import Numbers, Values
from .operations import FLOATS, LIBRARY, OPERATIONS
from .program import Atom, FixedNumber, Operation, Program, Variable

# Operations without a rounding error of their own.
_EXACT_WORDS = """
neg abs max min select sign floor ceil round_even round_away is_finite bits to_integer eq ne lt le gt ge and or not xor
"""
_EXACT = frozenset(_EXACT_WORDS.split())
_FLAT = _EXACT - {"neg", "abs", "max", "min", "select", "bits"}  # those of slope zero almost everywhere
_GROUP = 16  # steps that are joined first: below this the work of numpy itself outweighs that on the numbers
_AT_ONCE = 2**16  # numbers of a product that stay in the processor's cache
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
        return np.stack([np.asarray(np.broadcast_to(self(a), samples), float) for a in self.program.outputs], axis=1)

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
        return np.asarray(self.values[variable.index], float)  # no copy of what is double already

    def _table(self, columns: Sequence[Numbers]) -> Values:
        samples = len(self.values[self.program.inputs[0].index])
        return np.stack([np.asarray(np.broadcast_to(column, samples), float) for column in columns], axis=1)

    def _slopes(self, operation: Operation) -> list[Numbers | None]:
        """d result / d argument; None where the result is constant in the argument.

        Integers occur as the bits of a float, in the exponent arithmetic of the logarithm. Their slope is that of
        the float's relative change, so that a float passes through its bits and back with slope one.
        """
        name, kinds = operation.name, [atom.kind for atom in operation.arguments]
        arguments = [self(atom) for atom in operation.arguments]
        result = self.values[operation.result.index]
        if name == "bits":
            return [1.0 / np.asarray(arguments[0], float) if kinds[0] in FLOATS else np.asarray(result, float)]
        if operation.result.kind not in FLOATS:
            return [np.ones(()), None] if name in ("add", "sub") else [None] * len(kinds)
        if name in _FLAT or (name == "convert" and kinds[0] not in FLOATS):
            return [None] * len(kinds)
        slopes: list[Numbers | None] = list(
            _slopes(name, [np.asarray(each, float) for each in arguments], np.asarray(result, float))
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
        read = np.stack([np.abs(np.asarray(trace.values[v.index], float)) for v in program.inputs[:inputs]], axis=1)
        own = own + units[0] * np.einsum("kij,kj->ki", np.abs(slopes[:, :, :inputs]), read)
    if not state:
        return own
    gains = slopes[:, :, inputs:]
    with one_blas_thread(), np.errstate(all="ignore"):
        return _worst_case(gains[:, shown:], gains[:, :shown], own[:, shown:], own[:, :shown])


def _worst_case(moves: Values, reads: Values, kicks: Values, own: Values) -> Values:
    """The largest |y_k| of e_k+1 = A_k e_k + b_k, y_k = C_k e_k + d_k for all |b| <= kicks and |d| <= own.

    It is the sum of |C_k A_k-1 ... A_j+1| kicks_j over all j < k, the magnitude taken of the whole product. A product
    of magnitudes would grow without limit where two estimates of an observer trade off.

    The exact sum takes samples^2 products. Here it is exact at checkpoints, about 0.7 sqrt(samples) apart. Between two
    checkpoints the errors of the states at the last one are taken as independent, which can only enlarge the bound.

    Args:
        moves: A, shape (samples, states, states).
        reads: C, shape (samples, outputs, states).
        kicks: bound on |b|, shape (samples, states).
        own: bound on |d|, shape (samples, outputs).

    Returns:
        The bound on |y|, shape (samples, outputs).
    """
    samples, outputs = own.shape
    # A state that no error reaches (a copy of an input that is exact) takes no part.
    live = (kicks != 0.0).any(axis=0) | (moves != 0.0).any(axis=(0, 2))
    if not live.any():
        return own
    moves, reads, kicks = moves[:, live][:, :, live], reads[:, :, live], kicks[:, live]
    groups = max(1, round(0.7 * np.sqrt(samples) / _GROUP))
    # Steps that follow the last one change nothing before them: they fill the last interval.
    spare = -samples % (_GROUP * groups)
    moves, reads, kicks = (np.pad(each, [(0, spare)] + [(0, 0)] * (each.ndim - 1)) for each in (moves, reads, kicks))
    near, moves, reads, kicks = _joined(moves, reads, kicks[:, :, None] * np.eye(kicks.shape[1]), _GROUP)
    far, moves, reads, kicks = _joined(moves, reads, kicks, groups)
    # Backwards in time over the intervals: `ways` is the product A ... A from the end of this one to each later
    # checkpoint, `boxes` the bound on the state's error there, from the kicks of all intervals before.
    intervals, states, _ = moves.shape
    boxes, ways = np.zeros((intervals, states)), np.zeros((intervals, states, states))
    for place in range(intervals - 2, -1, -1):
        ways[place + 1] = np.eye(states)
        later = ways[place + 1 :]
        boxes[place + 1 :] += _reached(later, np.broadcast_to(kicks[place], (len(later), *kicks[place].shape)))
        later[...] = later @ moves[place]
    before = np.abs(reads) @ boxes[:, :, None]
    return own + sum(each.reshape(-1, outputs)[:samples] for each in (near, far, before))


def _joined(moves: Values, reads: Values, kicks: Values, every: int) -> tuple[Values, Values, Values, Values]:
    """`every` stretches of a run in a row become one, for all such groups side by side.

    All products belong to the start of a stretch (reads) or to its end (kicks): so a pair of a later output and an
    earlier kick takes one product, however many steps lie between the two.

    Args:
        moves: the state at the end of each stretch by the state at its start, shape (stretches, states, states).
        reads: the outputs within it by the state at its start, shape (stretches, outputs, states).
        kicks: its sources of error, as columns of the state at its end, shape (stretches, states, sources).
        every: how many are joined; a divisor of their number.

    Returns:
        (the bound on the outputs from the sources of earlier stretches of their group, shape (groups, every, outputs);
        moves, reads, kicks of the groups).
    """
    moves, reads, kicks = (each.reshape(-1, every, *each.shape[1:]) for each in (moves, reads, kicks))
    groups, _, outputs, states = reads.shape
    bound, sources = np.zeros((groups, every, outputs)), kicks.shape[3]
    moved, read = np.tile(np.eye(states), (groups, 1, 1)), np.empty_like(reads)
    parts = np.empty((groups, states, every * sources))
    for step in range(every):
        earlier = parts[:, :, : step * sources]
        bound[:, step] = _reached(reads[:, step], earlier)
        earlier[...] = moves[:, step] @ earlier
        parts[:, :, step * sources : (step + 1) * sources] = kicks[:, step]
        read[:, step] = reads[:, step] @ moved
        moved = moves[:, step] @ moved
    return bound, moved, read.reshape(groups, -1, states), parts


def _reached(rows: Values, columns: Values) -> Values:
    """The sum of the magnitudes of each row of rows @ columns, a few of the stacked matrices at a time."""
    many = max(1, _AT_ONCE // max(1, rows.shape[1] * columns.shape[2]))
    found = np.empty(rows.shape[:2])
    for first in range(0, len(rows), many):
        product = rows[first : first + many] @ columns[first : first + many]
        found[first : first + many] = np.abs(product, out=product).sum(axis=2)
    return found


def _evaluate(operation: Operation, arguments: list[Values]) -> Values:
    kind = operation.result.kind
    if operation.name == "bits":
        return np.ascontiguousarray(arguments[0]).view(kind).reshape(np.shape(arguments[0]))
    return np.asarray(OPERATIONS[operation.name].value(*arguments), kind)


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
