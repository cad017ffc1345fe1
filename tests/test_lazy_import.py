"""`import fpjax` is light; its public names are there all the same, and the modules' old names for one version more."""

import json
import pkgutil
import subprocess
import sys
import textwrap

import pytest

import fpjax


def run(code, *words):
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60, check=True
    ).stdout


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


MODULES = {
    "batch": ("compiled.batch", "map_chunks"),
    "friction.bristles": ("blocks.friction.bristles", "Bristles"),
    "plants": ("blocks.plants", "OneMass"),
    "estimate": ("analysis.estimate", "observe"),
    "logs.measures": ("logs.noise", "noise_level"),
    "gap.fit.kept": ("gap.fit.saved_fits", "Kept"),
}
# `Parameter`, `Tracking` and `Identifiability` are words of tuning.
SYMBOLS = {
    "fpjax": {"Estimation": "Estimated"},
    "fpjax.gap": {"Tracking": "TrackingError", "Identifiability": "FittedParameter", "Parameter": "EffectParameter"},
}


@pytest.fixture(scope="module")
def old_names():
    """{old name: (what using it for the first time warns of, whether it is the new one)}, all in one new process."""
    code = """
        import importlib, json, sys, warnings

        def tried(use):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    use()
                    told = "nothing"
                except DeprecationWarning as warning:
                    told = str(warning)
                warnings.simplefilter("ignore")
                return told, use()

        found = {}
        modules, symbols = json.loads(sys.argv[1])
        for old, (now, name) in modules.items():
            told, module = tried(lambda: importlib.import_module("fpjax." + old))
            found[old] = told, getattr(module, name) is getattr(importlib.import_module("fpjax." + now), name)
        for home, names in symbols.items():
            module = importlib.import_module(home)
            for old, now in names.items():
                told, value = tried(lambda: getattr(module, old))
                found[old] = told, value is getattr(module, now)
        print(json.dumps(found))
    """
    return json.loads(run(textwrap.dedent(code), json.dumps([MODULES, SYMBOLS])))


@pytest.mark.parametrize("old", MODULES)
def test_an_old_name_of_a_module_warns_and_works(old_names, old):
    told, same = old_names[old]
    assert f"fpjax.{old.partition('.')[0]}" in told
    assert "has moved to fpjax." in told
    assert same


@pytest.mark.parametrize(
    ("home", "old", "now"), [(home, *names) for home in SYMBOLS for names in SYMBOLS[home].items()]
)
def test_an_old_name_of_a_symbol_warns_and_works(old_names, home, old, now):
    told, same = old_names[old]
    assert told == f"{home}.{old} is now {home}.{now}; the old name goes with the next version"
    assert same


def test_an_old_module_does_not_hide_the_function_of_its_name():
    code = (
        "import warnings; warnings.simplefilter('ignore')\nimport fpjax\nfrom fpjax.simulate import make_inputs\n"
        "print(callable(fpjax.simulate), fpjax.batch.map_chunks.__module__, fpjax.gap.__name__)"
    )
    assert run(code).split() == ["True", "fpjax.compiled.batch", "fpjax.gap"]
