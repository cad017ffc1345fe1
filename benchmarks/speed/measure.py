"""The rows of the benchmark: values, gradients, growth, cores."""

import importlib.metadata
import importlib.util
import platform
import resource
import sys
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from fpjax.compiled.batch import chunk_for, cores, map_chunks
from fpjax.compiled.gradients import value_and_gradient
from fpjax.compiled.native import native, native_enabled
from fpjax.output.json_object import JsonObject

from . import cpp, peers, servo, timing

# Largest relative difference to the plain scan with which a row counts: 5,000 steps in another order of operations.
AGREE = {"float64": 1e-9, "float32": 2e-4}


def versions() -> dict[str, str]:
    """Versions of everything that is timed."""
    found = {"python": platform.python_version()}
    for name in ("jax", "jaxlib", "numpy", "numba", "diffrax"):
        if importlib.util.find_spec(name) is not None:
            found[name] = importlib.metadata.version(name)
    return found


def machine() -> JsonObject:
    """The processor and how many cores of it this process may use."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as file:
            model = next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), model)
    except OSError:
        pass
    return {"processor": model, "cores": cores(), "system": platform.system()}


def peak_memory() -> float:
    """The largest resident memory of this process so far [MB]."""
    unit = 1e6 if sys.platform == "darwin" else 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def steps_for(size: int, steps: int) -> int:
    """Steps of a run, a fifth for large batches: time is linear in the steps, and the peers would take minutes."""
    return steps if size <= 1024 else max(steps // 5, 1)


class Bench:
    """What all rows share: the C++ library (None where it cannot be built), versions, and what was skipped."""

    def __init__(self, steps: int, repeats: int, say: Callable[[str], None]) -> None:
        self.steps, self.repeats, self.say = steps, repeats, say
        self.versions = versions()
        self.skipped: list[dict[str, str]] = []
        built = cpp.build()
        self.cpp = None if isinstance(built, str) else built
        if isinstance(built, str):
            self.skipped.append({"implementation": "C++", "why": built})
        self.peers: dict[str, Callable[..., PyTree]] = {"numpy": peers.with_numpy}
        for name, make in (("numba", peers.with_numba), ("diffrax", peers.with_diffrax)):
            if importlib.util.find_spec(name) is None:
                self.skipped.append({"implementation": name, "why": f"{name} is not installed"})
            else:
                self.peers[name] = make

    def value_rows(self, dtype: DTypeLike, size: int) -> list[JsonObject]:
        """One row an implementation: the cost of `size` candidates of two gains, on one core."""
        steps = steps_for(size, self.steps)
        batch, reference = servo.candidates(size, 2, dtype), servo.table(steps, dtype)
        names = (["C++"] if self.cpp is not None else []) + [*self.peers, "vmap(lax.scan)", "fpjax"]
        calls = {name: self.value(name, batch, reference) for name in names}
        expected = np.asarray(calls["vmap(lax.scan)"]())
        errors = {name: float(np.max(np.abs(np.asarray(call()) / expected - 1.0))) for name, call in calls.items()}
        # The first calls above compiled; compile times are measured in fresh processes (first_call.py).
        times = timing.interleaved(calls, self.repeats)
        rows = []
        for name, spent in times.items():
            rows.append(self.row(name, "value", dtype, size, 2, steps, spent) | {"relative_error": errors[name]})
            if not errors[name] <= AGREE[np.dtype(dtype).name]:
                rows[-1]["disagrees"] = True
        return rows

    def call_row(self, dtype: DTypeLike, size: int) -> JsonObject:
        """The fixed cost of a call of the library: a run of two steps."""
        call = self.fpjax_value(servo.candidates(size, 2, dtype), 2, dtype, size)
        spent = timing.interleaved({"call": call}, self.repeats, budget=0.2)["call"]
        return {"dtype": np.dtype(dtype).name, "candidates": size, "processor_seconds": spent.processor_seconds}

    def value(self, name: str, batch: PyTree, reference: PyTree) -> Callable[[], PyTree]:
        """The call of one implementation, by its name in the rows."""
        size, steps = len(next(iter(batch.values()))), len(reference)
        if name == "C++":
            return self._fastest_cpp(batch, reference, size)
        if name == "vmap(lax.scan)":
            return self._plain(batch, reference)
        if name == "fpjax":
            return self.fpjax_value(batch, steps, reference.dtype, size)
        return self.peers[name](batch, reference)

    def fpjax_value(
        self, batch: PyTree, steps: int, dtype: DTypeLike, size: int, workers: int = 1
    ) -> Callable[[], PyTree]:
        """The library's own way: `native` under jit for a handful of candidates, `map_chunks` for more."""
        cost, shared = servo.library(steps, dtype)
        arrays = {name: jnp.asarray(value) for name, value in batch.items()}
        if size <= 5:
            run = jax.jit(native(jax.vmap(cost, in_axes=(0, None))))
            return lambda: run(arrays, *shared)
        return lambda: map_chunks(cost, arrays, shared, workers=workers, devices=jax.local_devices()[:1])

    def _plain(self, batch: PyTree, reference: PyTree) -> Callable[[], PyTree]:
        run = jax.jit(jax.vmap(servo.by_hand, in_axes=(0, None)))
        arrays = {name: jnp.asarray(value) for name, value in batch.items()}
        table = jnp.asarray(reference)
        return lambda: run(arrays, table)

    def _fastest_cpp(self, batch: PyTree, reference: PyTree, size: int) -> Callable[[], PyTree]:
        # The fastest number of lanes and tanh is found on a part, as a C++ user would tune it once.
        part = min(size, 64) if size % 64 == 0 else size
        small = {name: value[:part] for name, value in batch.items()}
        variants = {f"{width} {tanh}": (width, tanh) for width in cpp.widths(part) for tanh in (False, True)}
        trial = {name: cpp.runner(self.cpp, small, reference, *variant) for name, variant in variants.items()}
        times = timing.interleaved(trial, 3, 0.002, 0.3)
        best = min(times, key=lambda name: times[name].processor_seconds)
        return cpp.runner(self.cpp, batch, reference, *variants[best])

    def gradient_rows(self, dtype: DTypeLike, size: int, gains: int, with_plain: bool) -> list[JsonObject]:
        """Value, value and gradient by every mode, and the plain gradient, of the same candidates."""
        steps = self.steps
        batch = servo.candidates(size, gains, dtype)
        arrays = {name: jnp.asarray(value) for name, value in batch.items()}
        cost, shared = servo.library(steps, dtype)
        calls: dict[str, Callable[[], PyTree]] = {}
        scratch: dict[str, int | None] = {}
        chunk = chunk_for(arrays, size) if size > 5 else size
        block = {name: jnp.resize(value, (chunk,)) for name, value in arrays.items()}

        def over_candidates(candidates: PyTree, *shared: PyTree) -> PyTree:
            return jax.vmap(cost, in_axes=(0, None))(candidates, *shared)

        batched = size > 1
        if not batched:  # one simulation: scalars, as a user has them
            arrays = {name: value[0] for name, value in arrays.items()}
            block = arrays
        function = over_candidates if batched else cost
        functions: dict[str, Callable[..., PyTree]] = {"value": function}
        for mode in ("auto", "forward", "reverse"):
            functions[mode] = value_and_gradient(function, mode=mode, batched=batched)
        for name, function in functions.items():
            kernel = jax.jit(native(function))
            if size <= 5:
                calls[name] = lambda kernel=kernel: kernel(arrays, *shared)
            else:
                calls[name] = lambda function=function: map_chunks(
                    function, arrays, shared, batched=True, workers=1, devices=jax.local_devices()[:1]
                )
            scratch[name] = _scratch(kernel, block, *shared)
        if with_plain:
            reference = jnp.asarray(servo.table(steps, dtype))
            one = jax.value_and_grad(servo.by_hand)
            plain = jax.jit(jax.vmap(one, in_axes=(0, None)) if batched else one)
            calls["plain"] = lambda: plain(arrays, reference)
            scratch["plain"] = _scratch(plain, arrays, reference)
        # Forward mode is the reference of the other modes: it has no checkpoints and no reordering of time.
        expected = calls["forward"]()[1]
        agree = {}
        for name in calls:
            if name != "value":
                gradient = calls[name]()[1]
                agree[name] = max(_relative(gradient[key], expected[key]) for key in expected)
        times = timing.interleaved(calls, self.repeats)
        primal = times["value"].processor_seconds
        return [
            self.row("vmap(lax.scan)" if name == "plain" else "fpjax", name, dtype, size, gains, steps, spent)
            | {
                "over_value": spent.processor_seconds / primal,
                "scratch_bytes": scratch[name],
                "relative_error": agree.get(name),
            }
            for name, spent in times.items()
        ]

    def growth(self, dtype: DTypeLike, size: int = 64) -> dict[str, list[JsonObject]]:
        """Cost and memory of value and gradient by horizon and by number of gains, at `size` candidates."""
        horizon, gains = [], []
        for factor in (0.25, 1.0, 4.0, 16.0):
            other = Bench.__new__(Bench)
            other.__dict__.update(self.__dict__, steps=max(2, int(self.steps * factor)), repeats=2)
            horizon += other.gradient_rows(dtype, size, 2, with_plain=False)
        for count in (1, 2, 3, 4, 6, 8, 10):
            gains += self.gradient_rows(dtype, size, count, with_plain=False)
        return {"horizon": horizon, "gains": gains}

    def flat(self, dtype: DTypeLike, sizes: tuple[int, ...]) -> list[JsonObject]:
        """The library by batch alone: the same steps at every size, interleaved."""
        steps = max(self.steps // 2, 1)
        calls: dict[str, Callable[[], PyTree]] = {}
        for size in sizes:
            calls[str(size)] = self.fpjax_value(servo.candidates(size, 2, dtype), steps, dtype, size)
        # Long samples: the first calls of a small batch after a large one find the caches filled by the large one.
        times = timing.interleaved(calls, self.repeats, at_least=0.05)
        return [self.row("fpjax", "value", dtype, int(size), 2, steps, spent) for size, spent in times.items()]

    def row(
        self, name: str, what: str, dtype: DTypeLike, size: int, gains: int, steps: int, spent: timing.Timing
    ) -> JsonObject:
        """The fields that every row has."""
        each = spent.processor_seconds / steps
        self.say(f"{name} {what} {np.dtype(dtype).name} B={size} gains={gains}: {each * 1e9:.1f} ns/step")
        package = {"C++": cpp.version() if self.cpp is not None else "", "fpjax": f"jax {self.versions['jax']}"}
        package |= {"vmap(lax.scan)": package["fpjax"]}
        return {
            "implementation": name,
            "version": package.get(name) or f"{name} {self.versions.get(name, '')}",
            "native": native_enabled() if name == "fpjax" else None,
            "what": what,
            "dtype": np.dtype(dtype).name,
            "candidates": size,
            "gains": gains,
            "steps": steps,
            "seconds": spent.seconds,
            "processor_seconds": spent.processor_seconds,
            "ns_per_step": each * 1e9,
            "steps_per_second": size / each,
        }


def _relative(a: PyTree, b: PyTree) -> float:
    """Largest difference over the largest magnitude: single slopes pass through zero."""
    return float(jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b)))


def _scratch(function: PyTree, *arguments: PyTree) -> int | None:
    """Bytes that one call holds besides its inputs and outputs, by XLA's own account."""
    analysis = function.lower(*arguments).compile().memory_analysis()
    return None if analysis is None else int(analysis.temp_size_in_bytes)
