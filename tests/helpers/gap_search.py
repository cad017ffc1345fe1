"""The nominal model of `gap_machine.Machine`, and a search of the diagnosis over one of its logs."""

from fpjax.gap import EFFECTS
from fpjax.gap.attribute import Search
from fpjax.gap.family import Nominal
from fpjax.gap.record import make_record, window_seconds, with_common_noise
from fpjax.gap.sizes import make_setting
from fpjax.gap.vocabulary import on_rate_sensor
from fpjax.model_file import load_model

MODEL = """[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def search_of(log):
    model = load_model(MODEL)
    records = with_common_noise([make_record(log, window=window_seconds([log]))])
    effects = tuple(effect for effect in EFFECTS if not on_rate_sensor(effect))
    loop = model.loop
    return Search(records, Nominal(loop.plant, loop.actuator, loop.sensor), effects, make_setting(records, model))
