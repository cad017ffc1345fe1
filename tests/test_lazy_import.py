"""`import fpjax` is light; its public names are there all the same, and the modules' old names for one version more."""

import pkgutil
import subprocess
import sys

import pytest

import fpjax


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True).stdout


def test_importing_fpjax_and_its_log_reader_imports_no_jax():
    code = "import sys, fpjax, fpjax.errors, fpjax.logs; print(sorted({'jax', 'equinox', 'scipy'} & set(sys.modules)))"
    assert run(code).strip() == "[]"


def test_a_diagnosis_waits_for_nothing_that_only_pictures_or_filters_need():
    slow = {"matplotlib", "scipy.signal", "scipy.stats", "optax"}
    assert run(f"import sys, fpjax.gap; print(sorted({slow} & set(sys.modules)))").strip() == "[]"


def test_no_module_has_the_name_of_a_public_function():
    modules = {module.name for module in pkgutil.iter_modules(fpjax.__path__)}
    assert not modules & set(dir(fpjax))


def test_every_public_name_is_an_attribute():
    assert {"OneMass", "simulate", "read_log", "InputError"} <= set(dir(fpjax))
    for name in dir(fpjax):
        assert getattr(fpjax, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = fpjax.nothing


@pytest.mark.parametrize(
    ("old", "now", "name"),
    [
        ("batch", "compiled.batch", "map_chunks"),
        ("friction.bristles", "blocks.friction.bristles", "Bristles"),
        ("plants", "blocks.plants", "OneMass"),
        ("estimate", "analysis.estimate", "observe"),
        ("logs.measures", "logs.noise", "noise_level"),
        ("gap.fit.kept", "gap.fit.saved_fits", "Kept"),
    ],
)
def test_an_old_name_of_a_module_warns_and_works(old, now, name):
    code = (
        "import warnings; warnings.simplefilter('error'); import importlib\n"
        f"try: importlib.import_module('fpjax.{old}')\nexcept DeprecationWarning as warning: print(warning)\n"
        f"warnings.simplefilter('ignore')\nfrom fpjax.{old} import {name} as old\nfrom fpjax.{now} import {name}\n"
        f"print(old is {name})"
    )
    told, same = run(code).splitlines()
    assert f"fpjax.{old.partition('.')[0]}" in told
    assert "has moved to fpjax." in told
    assert same == "True"


def test_an_old_name_of_a_symbol_warns_and_works():
    code = (
        "import warnings; warnings.simplefilter('error'); import fpjax\n"
        "try: fpjax.Estimation\nexcept DeprecationWarning as warning: print(warning)\n"
        "warnings.simplefilter('ignore')\nprint(fpjax.Estimation is fpjax.Estimated)"
    )
    told, same = run(code).splitlines()
    assert told == "fpjax.Estimation is now fpjax.Estimated; the old name goes with the next version"
    assert same == "True"


def test_old_names_of_the_diagnosis_warn_and_work():
    """`Parameter`, `Tracking` and `Identifiability` are words of tuning."""
    code = (
        "import warnings; warnings.simplefilter('error')\nfrom fpjax import gap\n"
        "try: gap.Tracking\nexcept DeprecationWarning as warning: print(warning)\n"
        "warnings.simplefilter('ignore')\nfrom fpjax.gap import Identifiability, Parameter, Tracking\n"
        "print((Identifiability, Parameter, Tracking) == (gap.FittedParameter, gap.EffectParameter, gap.TrackingError))"
    )
    told, same = run(code).splitlines()
    assert told == "fpjax.gap.Tracking is now fpjax.gap.TrackingError; the old name goes with the next version"
    assert same == "True"


def test_an_old_module_does_not_hide_the_function_of_its_name():
    code = (
        "import warnings; warnings.simplefilter('ignore')\nimport fpjax\nfrom fpjax.simulate import make_inputs\n"
        "print(callable(fpjax.simulate), fpjax.batch.map_chunks.__module__, fpjax.gap.__name__)"
    )
    assert run(code).split() == ["True", "fpjax.compiled.batch", "fpjax.gap"]
