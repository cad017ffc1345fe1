"""The result of a sweep: the grid of costs, its `.npz` with named axes, its contour picture and its page."""

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from fpjax.errors import InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import refuse_unfinished, whole_file

from .sweep_axis import Axis, Paths


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """A grid of costs.

    Attributes:
        axes: of the grid; the first one varies slowest in the order of candidates.
        references: labels of the references.
        costs: shape (*counts, references) [1]; infinite where a run diverged; a memory map if the sweep had a folder.
        objective: its name.
        simulations: candidates x cases (references x plants x noise seeds).
        simulated_steps: simulations x samples.
        run_seconds: computing, compiling included.
        versions: of what computed it.
        identity: hash of everything that the costs depend on (`sweep_identity`); "" without a folder.
    """

    axes: tuple[Axis, ...]
    references: tuple[str, ...]
    costs: np.ndarray
    objective: str
    simulations: int
    simulated_steps: int
    run_seconds: float
    versions: dict[str, str]
    identity: str = ""

    def cost(self, reference: str | None = None) -> np.ndarray:
        """Costs on one reference, or their mean over all, shape (*counts).

        Raises:
            InputError: for a reference that was not swept.
        """
        if reference is None:
            # A mean over one column would read a memory map of a large sweep into memory.
            return self.costs[..., 0] if len(self.references) == 1 else self.costs.mean(axis=-1)
        if reference not in self.references:
            raise InputError(f"{reference!r} was not swept: choose among {', '.join(self.references)}.")
        return self.costs[..., self.references.index(reference)]

    def best(self, reference: str | None = None) -> tuple[dict[str, float], float]:
        """(values by name, cost) of the cheapest candidate on one reference, or on all of them."""
        cost = self.cost(reference)
        place = np.unravel_index(int(np.argmin(cost)), cost.shape)
        values = {axis.name: float(axis.values[i]) for axis, i in zip(self.axes, place, strict=True)}
        return values, float(cost[place])

    @property
    def diverged(self) -> int:
        """Candidates whose run diverged on some reference."""
        # A candidate counts once, on however many references it diverged.
        return int(np.count_nonzero(~np.all(np.isfinite(self.costs), axis=-1)))

    def to_dict(self) -> JsonObject:
        """Summary without the grid, as JSON takes it."""
        best = {label: self.best(label) for label in self.references}
        return {
            "objective": self.objective,
            "axes": [dataclasses.asdict(axis) for axis in self.axes],
            "best": {label: {"gains": gains, "cost": cost} for label, (gains, cost) in best.items()},
            "best_of_all": dict(zip(("gains", "cost"), self.best(), strict=True)),
            "diverged": self.diverged,
            "simulations": self.simulations,
            "simulated_steps": self.simulated_steps,
            "run_seconds": self.run_seconds,
            "versions": self.versions,
            "identity": self.identity,
        }

    def to_dataframe(self) -> Any:
        """A `pandas.DataFrame` with one row for each candidate: values by the axes' names, cost by reference.

        Raises:
            InputError: where pandas is not installed.
        """
        from fpjax.output.data_frames import to_frame

        # "ij": the order of `costs`, in which the first axis varies slowest.
        grid = np.meshgrid(*(axis.values for axis in self.axes), indexing="ij")
        columns = {axis.name: values.ravel() for axis, values in zip(self.axes, grid, strict=True)}
        costs = {f"cost on {label}": self.costs[..., i].ravel() for i, label in enumerate(self.references)}
        return to_frame(columns | costs)

    def save(self, path: str | Path) -> Path:
        """Write an `.npz`: `cost`, an array of values for each axis by its name, `axes` and `references` in order.

        Raises:
            InputError: where it cannot be written.
        """
        path = Path(path)
        small: dict[str, np.ndarray] = {axis.name: axis.values for axis in self.axes}
        small["axes"] = np.array([axis.name for axis in self.axes] + ["reference"])
        small["references"] = np.array(self.references)
        small["summary"] = np.array(json.dumps(self.to_dict()))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"The sweep cannot be written to {path} ({error.strerror}): choose another place."
            ) from error
        # np.savez would copy the memory map of a large sweep into memory; force_zip64 for arrays beyond 4 GiB.
        with whole_file(path) as whole, zipfile.ZipFile(whole, "w") as archive:
            for name, array in small.items():
                buffer = io.BytesIO()
                np.save(buffer, array)
                archive.writestr(f"{name}.npy", buffer.getvalue())
            with archive.open("cost.npy", "w", force_zip64=True) as file:
                _stream(file, self.costs)
        return path

    def plot(self, path: str | Path | None = None, reference: str | None = None, paths: Paths | None = None) -> Any:
        """Draw the cost as contours over the first two axes, or as a line over one; further axes at their best values.

        Args:
            path: picture file to write; None to write none.
            reference: label of the reference whose cost is shown; None for the mean over all.
            paths: of searches, by the method's name, each as `TuningResult.path` has it; drawn if there are two axes.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: where the picture cannot be written, or a path lacks a swept parameter.
        """
        from .sweep_plot import checked_paths, draw, slice_of

        shown = slice_of(self.axes, self.cost(reference), self._title(reference))
        return draw(shown, None if path is None else Path(path), checked_paths(self.axes, paths or {}))

    def page(self, path: str | Path, reference: str | None = None, paths: Paths | None = None) -> Path:
        """Write the picture as one HTML file without external resources that shows the cost under the pointer.

        Args:
            path: file to write.
            reference: label of the reference whose cost is shown; None for the mean over all.
            paths: as of `plot`.

        Raises:
            InputError: where it cannot be written, or a path lacks a swept parameter.
        """
        from .sweep_page import write_page
        from .sweep_plot import checked_paths, slice_of

        shown = slice_of(self.axes, self.cost(reference), self._title(reference))
        return write_page(shown, Path(path), checked_paths(self.axes, paths or {}))

    def _title(self, reference: str | None) -> str:
        return f"{self.objective} cost on {reference or ', '.join(self.references)}"

    def __str__(self) -> str:
        lines = [f"sweep of {self.simulations:,} simulations ({self.objective}), {self.run_seconds:.1f} s"]
        for label in (*self.references, *([None] if len(self.references) > 1 else [])):
            gains, cost = self.best(label)
            shown = ", ".join(f"{name} = {value:.6g}" for name, value in gains.items())
            lines.append(f"  {label or 'all references':<16} least cost {cost:.6g} at {shown}")
        if self.diverged:
            lines.append(f"  {self.diverged:,} candidates diverged")
        return "\n".join(lines)

    __repr__ = __str__


def load_sweep(path: str | Path) -> JsonObject:
    """The arrays of a file from `SweepResult.save` by name, with `summary` as a dictionary.

    Args:
        path: of the .npz.

    Raises:
        InputError: for the file of a run that did not finish.
    """
    refuse_unfinished(Path(path))
    with np.load(Path(path)) as archive:
        content = {name: archive[name] for name in archive.files}
    return content | {"summary": json.loads(str(content["summary"]))}


def _stream(file: Any, array: np.ndarray) -> None:
    """Write an array in `.npy` format in pieces of 2^20 numbers, so that a memory map is never in memory whole."""
    header = {"descr": np.lib.format.dtype_to_descr(array.dtype), "fortran_order": False, "shape": array.shape}
    np.lib.format.write_array_header_2_0(file, header)
    flat = array.reshape(-1)
    for first in range(0, flat.size, 1 << 20):
        file.write(np.ascontiguousarray(flat[first : first + (1 << 20)]).tobytes())
