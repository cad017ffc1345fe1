"""Gains by pole placement for machines that friction could hold."""

from model_files import body

import fpjax as fp

STUCK = (
    body(0.0047, "{coulomb}", 0.5)
    + """
[controller]
type = "pi"
[observer]
type = "efp"
[reference]
type = "multisine"
amplitudes = [0.19, 0.11]
frequencies = [5.8, 15.7]
[simulation]
dt = 1e-3
duration = 1.0
stepping = "sampled"
solver = "exact"
"""
)


def test_a_loop_without_gains_is_fast_enough_for_friction_not_to_hold_the_machine():
    model = fp.load_model(STUCK.format(coulomb=0.28))
    (said,) = [note for note in model.notes if note.startswith("[controller]")]
    assert "so fast that friction cannot hold it" in said
    run = fp.simulate(model)
    velocity = abs(run.signals["velocity"])
    assert velocity.max() > 0.5 * abs(run.signals["reference"]).max()  # it was 0: the machine never moved


def test_where_friction_is_small_it_has_no_say():
    model = fp.load_model(STUCK.format(coulomb=1e-3))
    (said,) = [note for note in model.notes if note.startswith("[controller]")]
    assert "friction" not in said
