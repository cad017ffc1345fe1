"""The C of a control law is the simulation: every controller and observer, compiled by the machine's compiler."""

import dataclasses
import shutil
import subprocess
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import one_of_each_kind
from catalogue_case import Case
from catalogue_drive import CONTROLLERS, OBSERVERS

import fpjax as fp
from fpjax.blocks.block import as_parameter
from fpjax.export.check import FLAGS, check_c, failures, find_compiler
from fpjax.export.rounding import Trace, run_bound
from fpjax.export.vectors import ULPS

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
DT = 1e-3


def model_of(loop, reference, dt=DT):
    return fp.Model(loop=loop, reference=reference, dt=dt, stepping="sampled")


def exported(loop, reference, folder, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fp.FpjaxWarning)  # the catalogue's steepness is for another step
        return fp.export_c(model_of(loop, reference), folder, check=True, **options)


def every_law():
    """Each kind of block in double precision; `long` in single precision, and the variants; `slow` these in single.

    Observers of one parameter stand with their first nonlinearity, and the other nonlinearities are variants.
    """
    for case in one_of_each_kind([*CONTROLLERS, *OBSERVERS]):
        variant = not isinstance(case, Case)
        (law,) = case.values if variant else (case,)
        variant |= law.name.split("_")[0] in ("cfp", "mfp", "nfp") and "_g1_" not in law.name
        yield pytest.param(law, "double", id=f"{law}-double", marks=[pytest.mark.long] if variant else [])
        yield pytest.param(law, "float", id=f"{law}-float", marks=pytest.mark.slow if variant else pytest.mark.long)


@pytest.mark.parametrize(("case", "precision"), list(every_law()))
def test_the_c_of_every_controller_and_observer_is_the_simulation(case, precision, tmp_path):
    loop, reference = case.loop(case.build())
    found = exported(loop, reference, tmp_path, precision=precision, duration=1.0)
    assert found.checked.passed
    assert found.checked.rows == 1001
    assert max(found.checked.steps.values()) <= ULPS
    assert set(found.checked.runs) == set(found.law.outputs)
    assert all(np.isfinite(bound) for bound in found.bounds.values())
    # The run is the simulation, not only near its own bound: within a millionth of the torque, or 1e-13 in double.
    law = found.law.loop.controller
    inner = getattr(law, "controller", law)  # a feed-forward's torque is as large as that of what it stands around
    size = max(1.0, float(inner.kp) if hasattr(inner, "kp") else 1.0)
    allowed = size * (1e-4 if precision == "float" else 1e-11)
    if isinstance(law, fp.PositionFeedforward):
        # Two filtered differences of a position that is known to half a unit in its last place.
        peak = max(abs(float(reference.readout(jnp.asarray(t)))) for t in np.arange(0.0, 1.0, DT))
        unit = np.finfo(np.float32 if precision == "float" else np.float64).eps / 2.0
        allowed += float(law.inertia) * 4.0 * unit * peak / max(float(law.lag), DT) ** 2
    assert found.checked.runs["torque"] <= allowed


def test_single_precision_keeps_its_bound_over_ten_seconds(tmp_path):
    loop = fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, 500.0)),
        fp.ProportionalIntegral(800.0, 8000.0, 60.0, 0.02),
        fp.ExtendedFriedlandPark(10.0, 100.0, 100.0, 500.0),
    )
    found = exported(loop, fp.Sine(1.0, 0.5), tmp_path, precision="float")
    assert found.checked.rows == 10_001
    assert all(ratio <= 1.0 for ratio in found.checked.bounds.values())
    # The bound is the worst case of ten thousand roundings, and says something all the same.
    assert found.bounds["torque"] < 0.05 * 60.0
    assert found.checked.runs["torque"] < 1e-4 * 60.0


@pytest.mark.parametrize("rounded_inputs", [False, True])
def test_the_bound_is_the_sum_over_all_earlier_roundings(rounded_inputs, tmp_path):
    loop = fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, 500.0)),
        fp.ProportionalIntegral(150.0, 200.0),
        fp.ExtendedFriedlandPark(10.0, 100.0, 100.0, 500.0),
    )
    law = exported(loop, fp.Sine(1.0, 2.0), tmp_path, duration=1.5).law  # some intervals, the last one not full
    many, shown, unit = len(law.inputs), len(law.outputs), 2.0**-53
    columns = many + 3 * len(law.states) + 4 * shown
    rows = np.fromfile(tmp_path / "servo_vectors.bin").reshape(1501, columns)
    trace = Trace(law.program, rows[:, : many + len(law.states)])
    own, slopes = trace.sensitivities(2.0 * unit)
    if rounded_inputs:
        own = own + unit * (np.abs(slopes[:, :, :many]) @ np.abs(rows[:, :many, None]))[:, :, 0]
    moves, kicks = slopes[:, shown:, many:], own[:, shown:]
    # |C_k A_k-1 ... A_j+1| kicks_j for every pair of steps: `ways` of all k at once, from j = k - 1 down to 0
    exact, ways = own[:, :shown].copy(), slopes[:, :shown, many:].copy()
    for j in reversed(range(len(rows) - 1)):
        exact[j + 1 :] += np.abs(ways[j + 1 :]) @ kicks[j]
        ways[j + 1 :] = ways[j + 1 :] @ moves[j]
    ratio = run_bound(trace, many, (unit, unit), rounded_inputs)[exact > 0.0] / exact[exact > 0.0]
    assert ratio.min() >= 1.0 - 1e-12
    assert ratio.max() <= 1.2, "between two checkpoints the states' errors count as independent"
    assert np.median(ratio) <= 1.05


def test_the_check_fails_where_the_c_is_not_the_simulation(tmp_path):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.ProportionalIntegral(150.0, 200.0))
    found = exported(loop, fp.Sine(1.0, 1.0), tmp_path, duration=0.5)
    source = (tmp_path / "servo_control.c").read_text()
    assert source.count("150.0") == 1
    (tmp_path / "servo_control.c").write_text(source.replace("150.0", "150.00000000001"))
    build = ["cc", *FLAGS, "servo_control.c", "servo_test.c", "-o", "changed", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True, timeout=60)
    changed = str(tmp_path / "changed")
    ran = subprocess.run([changed, "servo_vectors.bin"], cwd=tmp_path, capture_output=True, timeout=60)
    assert ran.returncode == 1
    assert b"FAILED" in ran.stdout
    # The embedded rows judge alike, for a target without a file system.
    assert subprocess.run([changed], capture_output=True, timeout=60).returncode == 1
    assert found.checked.passed
    # what is told of the run is of one sample: the difference there, over the bound there
    again = check_c(found.law, found.code, tmp_path)
    apart, sample = again.nearest["torque"]
    bound = np.fromfile(tmp_path / "servo_vectors.bin").reshape(501, -1)[sample, -len(found.law.outputs)]
    assert apart / bound == pytest.approx(again.bounds["torque"])
    assert f"torque by {apart:.3g} N m in the run's sample {sample} (" in "; ".join(
        failures(again, dict.fromkeys(found.law.outputs, "N m"))
    )


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("steepness", [80.0, None])
def test_a_filtered_velocity_may_decay_to_nothing(steepness, precision, tmp_path):
    """At rest it halves and halves: XLA makes zero of what is subnormal, C does not, and neither is wrong by that."""
    moving = np.minimum(np.arange(2001) * DT, 0.1)
    loop = fp.ClosedLoop(
        fp.OneMass(0.02, fp.CoulombViscous(0.3, 0.05)),
        fp.PositionLoop(20.0, fp.ProportionalIntegral(1.0, 5.0)),
        fp.ClassicalFriedlandPark(0.02, fp.LogCosh(1.0, 80.0), 0.05, steepness),
        sensor=fp.Encoder(3e-4, filter_time=1e-3),
    )
    model = fp.Model(loop=loop, reference=fp.Recorded(moving, DT), dt=DT, stepping="sampled", solver="exact")
    made = fp.export_c(model, tmp_path, check=True, precision=precision, duration=2.0)
    assert made.checked.passed


def test_an_output_that_is_always_zero_has_no_bound_to_tell(tmp_path):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.ProportionalIntegral(150.0, 200.0))
    assert exported(loop, fp.Sine(1.0, 1.0), tmp_path, duration=0.1).bounds["compensation"] == 0.0


def test_gains_keep_their_names_units_and_values(tmp_path):
    loop = fp.ClosedLoop(
        fp.OneMass(10.0, fp.Viscous(2.0)),
        fp.ProportionalIntegral(150.0, 200.0, 40.0, 0.02),
        fp.ExtendedFriedlandPark(10.0, 100.0, 50.0, 400.0),
    )
    code = exported(loop, fp.Sine(1.0, 1.0), tmp_path, duration=0.1).code
    assert "static const double controller_kp = 150.0; /* proportional gain [N m s/rad] */" in code.source
    assert "-controller_limit" in code.source, "the anti-windup's limit is a parameter, on both sides"
    assert "double velocity; /* [rad/s], as measured */" in code.header
    assert "double viscous_estimate; /* [N m s/rad] */" in code.header
    assert "malloc" not in code.source
    assert code.libm == ("exp", "fabs"), "tanh and the logarithm are written out as the simulation has them"


class Odd(fp.AbstractController):
    """A user's own: a vector of memory, a branch, a short loop, a library function."""

    gain: jax.Array = eqx.field(converter=as_parameter)

    def init(self):
        return jnp.zeros((3,), self.gain.dtype), jnp.zeros((), jnp.int32)

    def derivative(self, state, reference, measurement):
        raise NotImplementedError

    def readout(self, state, reference, measurement):
        window, count = state
        error = reference - measurement.velocity
        mean = jnp.sum(jnp.stack([error, *window])) / 4.0
        eased = jax.lax.cond(jnp.abs(error) > 0.1, lambda e: e, lambda e: jnp.arctan(e), mean)
        power = jax.lax.fori_loop(0, 3, lambda i, x: 0.5 * x + eased, eased)
        return self.gain * power * jnp.where(count > 5, 1.0, 0.5).astype(error.dtype)

    def step(self, state, reference, measurement, dt):
        window, count = state
        error = reference - measurement.velocity
        return jnp.concatenate([error[None], window[:-1]]), jnp.minimum(count + 1, 100)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_a_block_of_the_users_own_exports_too(precision, tmp_path):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), Odd(50.0))
    found = exported(loop, fp.Sine(1.0, 1.0), tmp_path, precision=precision, duration=0.5)
    assert found.checked.passed
    assert found.law.states == ("controller_0_0", "controller_0_1", "controller_0_2", "controller_1")
    assert "atan" in " ".join(found.code.libm)


class Sorting(Odd):
    def readout(self, state, reference, measurement):
        return self.gain * jnp.sort(jnp.stack([reference, measurement.velocity, state[0][0]]))[1]


def test_a_primitive_without_c_is_named(tmp_path):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), Sorting(50.0))
    with pytest.raises(fp.InputError, match=r"cannot be written as C: sort .*is a primitive of jax that the export"):
        fp.export_c(model_of(loop, fp.Sine(1.0, 1.0)), tmp_path)


def test_bad_input_is_one_sentence(tmp_path, monkeypatch):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.ProportionalIntegral(150.0, 200.0))
    model = model_of(loop, fp.Sine(1.0, 1.0))
    with pytest.raises(fp.InputError, match=r"not a C identifier"):
        fp.export_c(model, tmp_path, name="2nd axis")
    with pytest.raises(fp.InputError, match=r"precision = 'half'"):
        fp.export_c(model, tmp_path, precision="half")
    fast = model_of(fp.ClosedLoop(loop.plant, fp.ProportionalIntegral(1e6, 200.0)), fp.Sine(1.0, 1.0))
    with pytest.raises(fp.InputError, match=r"diverges at a control period of 0\.001 s"):
        fp.export_c(fast, tmp_path, check=True)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(fp.InputError, match=r"needs a C compiler"):
        fp.export_c(model, tmp_path, check=True)
    names = {"servo_control.h", "servo_control.c", "servo_test.c", "servo_vectors.h"}
    assert names <= {path.name for path in tmp_path.iterdir()}, "written, unchecked"


def test_cc_may_hold_flags_and_is_not_replaced_silently(tmp_path, monkeypatch):
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.ProportionalIntegral(150.0, 200.0))
    monkeypatch.setenv("CC", "cc -DNOTHING")
    assert find_compiler() == [shutil.which("cc"), "-DNOTHING"]
    assert exported(loop, fp.Sine(1.0, 1.0), tmp_path, duration=0.1).checked.passed
    monkeypatch.setenv("CC", "nocc -m32")
    with pytest.raises(fp.InputError, match=r"CC = 'nocc -m32' names no program"):
        exported(loop, fp.Sine(1.0, 1.0), tmp_path, duration=0.1)


def test_names_in_c_are_ascii(tmp_path):
    path = tmp_path / "mödel ñ 1.toml"
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.ProportionalIntegral(150.0, 200.0))
    made = fp.export_c(dataclasses.replace(model_of(loop, fp.Sine(1.0, 1.0)), path=path), tmp_path)
    assert made.code.name == "model_n_1"
    with pytest.raises(fp.InputError, match="is not a C identifier"):
        fp.export_c(model_of(loop, fp.Sine(1.0, 1.0)), tmp_path, name="mödel")


def test_python_in_single_precision_exports_double_all_the_same(tmp_path):
    code = (
        "import fpjax as fp; from pathlib import Path\n"
        'text = \'[plant]\\ntype="one_mass"\\ninertia=10.0\\n[friction]\\ntype="coulomb_viscous"\\ncoulomb=20.0\\n'
        'viscous=2.0\\n[controller]\\ntype="pi"\\nkp=150.1\\nki=200.0\\n[simulation]\\ndt=1e-3\\n\'\n'
        f"found = fp.export_c(text, {str(tmp_path)!r}, check=True, duration=0.2)\n"
        "print(found.checked.passed, '150.1;' in found.code.source, len(found.notes))"
    )
    import sys

    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert ran.stdout.split() == ["True", "True", "3"]
