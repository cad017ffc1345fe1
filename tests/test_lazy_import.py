"""`import fpjax` is light; its public names are there all the same, functions before modules of the same name."""

import pkgutil
import subprocess
import sys
import types

import pytest

import fpjax


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True).stdout


def test_importing_fpjax_and_its_log_reader_imports_no_jax():
    code = "import sys, fpjax, fpjax.errors, fpjax.logs; print(sorted({'jax', 'equinox', 'scipy'} & set(sys.modules)))"
    assert run(code).strip() == "[]"


def test_a_submodule_never_hides_a_function_of_its_name():
    code = "import fpjax.simulate, fpjax; print(callable(fpjax.simulate), fpjax.loop.__name__, fpjax.gap.__name__)"
    assert run(code).split() == ["True", "fpjax.loop", "fpjax.gap"]
    from fpjax import public

    modules = {module.name for module in pkgutil.iter_modules(fpjax.__path__)}
    shadowed = {name for name in modules & set(vars(public)) if not isinstance(getattr(public, name), types.ModuleType)}
    assert shadowed <= fpjax._SHADOWED


def test_every_public_name_is_an_attribute():
    assert {"OneMass", "simulate", "read_log", "InputError"} <= set(dir(fpjax))
    for name in dir(fpjax):
        assert getattr(fpjax, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = fpjax.nothing
