"""Old names of modules that moved since 0.1: they work for one more version, with a warning.

The finder is the last one in `sys.meta_path`, so it is only asked for modules that no other finder has found.
"""

import importlib
import importlib.machinery
import sys
import types
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from typing import Any

_ROOMS = {
    "analysis": ("estimate", "excitation", "identify"),
    "blocks": (
        *("actuators", "block", "controllers", "friction", "loads", "observers", "position_torque"),
        *("references", "sensors", "servo_sensor", "signals"),
    ),
    "blocks.plants": ("sticking", "transmission"),
    "compiled": ("batch", "elementary", "gradients", "hyperbolic", "native", "one_kernel", "threads"),
    "output": ("plotting", "progress", "runfile", "toml_text"),
    "simulation": ("loop", "metrics", "scan", "solvers", "stability"),
}
_ROOMS_OF_LOGS = {
    "checks": ("inspection", "suspicions"),
    "columns": ("units",),
    "dynamics": ("derivative", "nominal", "regression"),
}
MOVED = {
    **{name: f"{room}.{name}" for room, names in _ROOMS.items() for name in names},
    "plants": "blocks.plants",
    "parameters": "blocks.parameters",
    "public": "",
    "simulate": "",
    "logs.measures": "logs.noise",
    "gap.fit.kept": "gap.fit.saved_fits",
    **{f"logs.{name}": f"logs.{room}.{name}" for room, names in _ROOMS_OF_LOGS.items() for name in names},
}
"""Old name of a module -> its present name, both without `fpjax.`."""
RENAMED = {"Estimation": "Estimated"}
"""Old name of a public symbol -> its present name. `Estimation` is now the name of a tuning objective only."""


class _OldName(types.ModuleType):
    """Stands for the module of the new name. It can be called, because `fpjax.simulate` was a function and a module."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # attributes of the import system must be this module's own, above all `__path__`
            raise AttributeError(name)
        return getattr(self.__dict__["_now"], name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return getattr(self, self.__name__.rpartition(".")[2])(*args, **kwargs)


class _OldNames(MetaPathFinder, Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if not fullname.startswith("fpjax.") or _now(fullname) is None:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        now = _now(spec.name)
        assert now is not None  # `find_spec` looked
        module = _OldName(spec.name)
        module.__dict__["_now"] = importlib.import_module(now)
        warnings.warn(
            f"{spec.name} has moved to {now}; the old name goes with the next version", DeprecationWarning, stacklevel=2
        )
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        pass


def _now(fullname: str) -> str | None:
    """The present full name of a module by its old one, also of a module in a folder that moved; None for any other."""
    head, rest = fullname.removeprefix("fpjax."), ""
    while head not in MOVED:
        if "." not in head:
            return None
        head, _, last = head.rpartition(".")
        rest = f".{last}{rest}"
    return f"fpjax.{MOVED[head]}{rest}".rstrip(".")


def warn_of(old: str, now: str) -> None:
    """Warn that a public symbol has a new name."""
    warnings.warn(f"{old} is now {now}; the old name goes with the next version", DeprecationWarning, stacklevel=3)


def keep_old_names() -> None:
    """Make the old names importable; a second call does nothing."""
    if not any(isinstance(finder, _OldNames) for finder in sys.meta_path):
        sys.meta_path.append(_OldNames())


def is_module(name: str) -> bool:
    """Whether `fpjax/` holds a module of this name (not only an old name of one)."""
    return importlib.machinery.PathFinder.find_spec(f"fpjax.{name}", sys.modules["fpjax"].__path__) is not None
